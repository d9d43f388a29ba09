"""Equations as numba kernels on scalars and small arrays, shared by twin and observer."""
