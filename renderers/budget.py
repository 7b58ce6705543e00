"""How the tolerance of a picture is shared out.

The tolerance is the relative root mean square error of linear radiance.  Errors of different origin do not know of each other, so
they add up in squares: half of the square goes to noise, which is what takes time in a render; a quarter to approximations of the
renderer (the continuous medium in place of particles, smoothing); a quarter to the tables of the asset.
"""

from __future__ import annotations

import math

DEFAULT = 0.05  # tolerance of scenes that say none
NOISE, APPROXIMATIONS, TABLES = math.sqrt(0.5), 0.5, 0.5  # shares of the tolerance; squares add up to 1
