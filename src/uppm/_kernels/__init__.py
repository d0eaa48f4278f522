"""Numba kernels, each with a NumPy reference in `reference.py`.

Structure of arrays; parallel over blocks, tiles or a fixed number of parts, so that results do not depend on the number
of threads.
"""
