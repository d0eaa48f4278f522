"""Numba kernels, each with a NumPy reference in `reference.py`.

Structure of arrays; parallel over blocks, tiles or a fixed number of parts, so that results do not depend on the number
of threads. Without fast-math: with it, machine code may differ in its last bits between a kernel compiled beside its
callees and one compiled against cached ones, and a resumed run would not be the unbroken one.
"""

import os

# Threads that wait for the next kernel sleep: spinning, they take the cores from perception, and on a busy machine each
# parallel region costs a time slice. Read when the first kernel starts its threads.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
