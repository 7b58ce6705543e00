"""Phase functions on one grid of angles, and the coefficients of a medium."""
