"""The renderer that needs nothing but NumPy and numba."""
