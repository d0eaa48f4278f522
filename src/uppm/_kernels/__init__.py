"""Numba kernels, each with a NumPy reference in `reference.py`. Structure of arrays; parallel over blocks; deterministic."""
