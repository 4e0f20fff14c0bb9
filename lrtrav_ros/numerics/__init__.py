"""Numerical foundations: how kernels are compiled, checks of their arguments, and reproducible BLAS."""
