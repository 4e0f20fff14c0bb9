"""Foundations of the arithmetic: compiled kernels, checks of their arguments, and BLAS that repeats itself."""
