"""From albedo and moments to a propagator with a stated error: how many orders, what the cut costs."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from bakery.physics.multiple import legendre, point
from bakery.physics.multiple.fourier import Propagator, propagator

TOLERANCE = 2e-4  # largest moment that is cut; lobes are then right to 1e-4 .. 1e-3, behind the source to 1e-2
MOST = 128  # orders; the work grows as their cube to fourth power
_COARSE = 0.75  # order of the second solution over that of the first
_LOOK = 8  # moments beyond the last, of which the largest counts as cut


@dataclass(frozen=True)
class Solution:
    """Third and later events, solved twice."""

    medium: Propagator
    solve_coarse: Callable[[], Propagator]  # solves for the same with fewer orders, `coarse`
    # largest moment left out over the largest that `coarse` leaves out: the error of `medium` over the difference of the two
    cut: float

    @cached_property
    def coarse(self) -> Propagator:
        """Not before an error is asked for: with all lobes of a table beside it, it would be what a bake's memory ends at."""
        return self.solve_coarse()

    def error(self, r, angle):
        """Estimated error of the lobe at r, angle: root mean square over directions over that of the lobe itself.

        Against solutions with many more orders the true error was 0.25 to 2.5 times the estimate (g = -0.8 .. 0.9;
        0.1 to 10 mfp).  Distances are those of the solution's grid that come closest, at most 8 % away, so that many positions
        share one.
        """
        order = self.medium.order
        grid = self.medium.log_r
        r = np.exp(grid[np.clip(np.rint((np.log(r) - grid[0]) / (grid[1] - grid[0])).astype(int), 0, len(grid) - 1)])
        fine, coarse = point.coefficients(self.medium, r, angle), point.coefficients(self.coarse, r, angle)
        twice = np.concatenate([np.where(np.arange(l + 1) == 0, 1.0, 2.0) for l in range(order + 1)])
        square = _norms(fine, twice)
        fine[..., :coarse.shape[-1]] -= coarse
        return self.cut * np.sqrt(np.divide(_norms(fine, twice), square, out=np.zeros_like(square), where=square > 0))


def _norms(c, twice):
    """Sums (...,) of squares of coefficients (..., P), a row at a time: in whole arrays this took the most memory of a bake."""
    rows = c.reshape(-1, c.shape[-1])
    return np.array([np.sum(twice * row**2) for row in rows]).reshape(c.shape[:-1])


def solve(albedo, p, *, tolerance=TOLERANCE, most=MOST) -> Solution:
    """Solves for the third and later events with as many orders as the phase function needs.

    albedo : 1, 0 to 1
    p : Legendre moments, to well beyond where they fall below the tolerance
    tolerance : largest moment that may be cut
    most : orders, at most

    Raises ValueError : more orders are needed (`peaks.solve` takes narrow forward peaks, photons narrow ones backward), or the
        moments end before the tolerance
    """
    p = np.asarray(p, float)
    order = legendre.order_needed(p, tolerance)
    if order is None or order > most:
        raise ValueError(f"more than {most} orders, or more moments, are needed: the last of {len(p)} is {abs(p[-1]):.2g}, and "
                         f"those beyond the last order are to be below {tolerance:g}; `peaks` cuts a forward peak")
    coarse, cut = coarser(p, order)
    return Solution(propagator(albedo, p[:order + 1]), partial(propagator, albedo, p[:coarse + 1]), cut)


def coarser(p, order):
    """Order of the second solution beside one of the moments p up to `order`, and `Solution.cut` of the two."""
    coarse = int(_COARSE * order)
    # where the moments end with the order, the last ones stand for what was cut
    beyond = np.abs(p[order + 1:order + 1 + _LOOK] if len(p) > order + 1 else p[-2:]).max(initial=0.0)
    lost = np.abs(p[coarse + 1:coarse + 1 + _LOOK]).max(initial=0.0)
    return coarse, float(beyond / lost) if lost > 0 else 0.0
