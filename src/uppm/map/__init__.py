"""The panoptic map: its file, its surfaces, its pictures, its queries. Imports `core` and `_kernels` only."""
