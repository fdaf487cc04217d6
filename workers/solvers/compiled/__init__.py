"""Periodic planar motions by kernels that numba compiles: windows, period, samples, bounds of errors."""
