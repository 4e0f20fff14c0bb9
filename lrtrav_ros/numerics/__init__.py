"""Numerical foundations: how kernels are compiled, checks of their arguments, threads, and reproducible BLAS."""
