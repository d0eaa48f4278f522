"""Networks that are not in the package: which there are, where their files are, and on which device they run."""
