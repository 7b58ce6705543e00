"""Coefficients and phase function of a continuous medium."""
