"""Types, geometry, validation, errors, configuration, protocols. Imports nothing of the package's other folders."""
