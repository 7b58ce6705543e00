"""How the tolerance of a table, an error of lobes, is shared out between what makes the table.

A table of the solver: its basis, then cells, which are divided until what lies between corners is within the tolerance.  A table
of photons: its basis, then noise, whose square falls as the number of photons.  What no share is for is measured, and stated
beside the table's own error: the solver's, and moments beyond the last one.
"""

BASIS = 0.5  # that the basis may miss: errors of coefficients add to it as squares
SEGMENT = 0.2  # the same of a table of segments, which is made of a table of points and has its errors besides
GAIN = 2  # by which quarters of a cell are better than the cell at least: those that are good enough then are not looked at
BIAS = 0.7  # that a bias of photons may take, at most: the rest is for their noise
COARSEST = 0.1  # tolerance that a basis of photons knows: with 50 % a table for g = -0.999 was wrong by 52 % instead of 29 %
REACHED = 0.01  # what the solver reaches for lobes that it just resolves (g = 0.9: 0.5 %): a default below would miss itself
