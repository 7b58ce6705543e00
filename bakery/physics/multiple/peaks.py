"""A phase function without its forward peak: clipped as a function of the angle, so that few Legendre moments hold the rest.

Below an angle the phase function is replaced by a smooth cap that lies between 0 and it.  The light above the cap is the peak: it
counts as unscattered.  What remains is a phase function like any other, positive and exact for a solver of that many orders.
Taking the peak out of the moments instead (delta-M, Wiscombe 1977) keeps the moments and loses the phase function: it rings.

Light in the peak is deflected all the same, by less than that angle.  The solver does that too between the events that count, so
what it finds is right for the undivided phase function, however much light is in the peak.
"""

import math
from dataclasses import dataclass
from functools import partial

import numpy as np

from bakery.physics.medium import phase as tables
from bakery.physics.medium.similarity import without_peak
from bakery.physics.multiple import basis, fourier, legendre, point, solution

TOLERANCE = 2e-4  # largest moment that the cap leaves beyond the last order, as `legendre.order_needed`
_DEGREE = 3  # of the cap, in 1 - cos theta; 2 needs a wider one, 4 gains nothing
_BEYOND = 2.5  # times the last order: moments that the cap is fitted to
_NARROWEST, _WIDEST, _WIDER = 4.0, 10.0, 1.06  # angle of the first and last cap times the order, and from one to the next
_NEARLY = 1.5  # times the least that any cap leaves, where none gets below the tolerance
_NONE = 1e-9  # share of a peak that is rounding
_DISTANCES, _ANGLES = 24, 9  # places of the effect
_SOLVED = 0.45  # of the solver's longest distance
_INSIDE = 128  # angles below the cap's, beyond which the fit takes fewer


@dataclass(frozen=True)
class Clipped:
    """A phase function without its forward peak, and the medium that goes with it.

    Light in the peak counts as unscattered.  With it the meaning of an event changes: single and double scattering beside a table
    of such a medium have to be taken with this phase function, albedo and mean free path.
    """

    peak: float  # share f of the scattered light above the cap
    angle: float  # rad, where the cap ends
    phase: np.ndarray  # (A,) 1/sr, of the rest, integrates to 1
    moments: np.ndarray  # (P,) of the rest, to 2.5 order and a little more
    deflection: np.ndarray  # (P,) moments of the peak: 1 for undeflected light

    def albedo(self, albedo):
        """Albedo of the medium without the peak."""
        return without_peak(albedo, self.peak)[0]

    def extinction(self, albedo):
        """sigma_t of the medium without the peak over that of the medium with it."""
        return without_peak(albedo, self.peak)[1]


def clipped(theta, phase, order, tolerance=TOLERANCE) -> Clipped:
    """Takes the forward peak that moments up to `order` cannot resolve out of a phase function.

    theta : (A,) rad, ascending from 0 (forward) to pi
    phase : (A,) 1/sr, linear in cos theta, integrates to 1
    order : of the highest moment that will be kept
    tolerance : largest moment beyond it

    Returns Clipped : by the narrowest cap that reaches the tolerance, by none where none is needed.  Where none reaches it,
        because the phase function has narrow features elsewhere (rainbows, halos, a glory), by the narrowest that leaves at most
        1.5 times as much as the best
    Raises ValueError : what cannot be resolved is not a forward peak (a backward one cannot be left out)

    The cap is a polynomial in 1 - cos theta that continues the phase function; its other coefficients are those that leave least
    squares of moments from order + 1 to 2.5 order.  Angles of caps are angles of the table.
    """
    theta, phase = np.asarray(theta, float), np.asarray(phase, float)
    top = int(_BEYOND * order) + 8
    whole = legendre.moments(theta, phase, top)
    if np.abs(whole[order + 1:]).max() <= tolerance:
        return Clipped(0.0, 0.0, phase, whole / whole[0], np.ones_like(whole))
    steps = math.ceil(math.log(_WIDEST / _NARROWEST) / math.log(_WIDER))
    wanted = np.minimum(_NARROWEST / max(order, 1) * _WIDER ** np.arange(steps + 1), math.pi)
    ends = np.unique(np.maximum(np.searchsorted(theta, wanted * (1 - 1e-12)), 1))
    # moments of the table beyond each angle: of pieces, added from the back
    outer = [legendre.moments(theta[ends[-1]:], phase[ends[-1]:], top) if ends[-1] < len(theta) - 1 else np.zeros(top + 1)]
    for i, j in zip(ends[-2::-1], ends[:0:-1], strict=True):
        outer.insert(0, outer[0] + legendre.moments(theta[i:j + 1], phase[i:j + 1], top))
    least, cuts = math.inf, []
    for end, beyond in zip(ends, outer, strict=True):
        outside_cap = np.append(_cap(theta[:end + 1], phase[:end + 1], beyond, order), phase[end + 1:])
        share = float(tables.phase_integral(theta, outside_cap))
        p = beyond + legendre.moments(theta[:end + 1], outside_cap[:end + 1], top)
        unresolved = np.abs(p[order + 1:]).max() / share if share > 0 else math.inf
        cuts.append((unresolved, end, share, outside_cap, p))
        least = min(least, unresolved)
        if unresolved <= tolerance:
            break
    enough = tolerance if least <= tolerance else _NEARLY * least
    unresolved, end, share, outside_cap, p = next(cut for cut in cuts if cut[0] <= enough)
    legendre.refuse_backward(p / p[0], order)
    peak = max(1 - share, 0.0)
    deflection = (whole - p) / (whole[0] - p[0]) if peak > _NONE else np.ones_like(p)
    outside_cap, _ = tables.normalised(theta, outside_cap)
    return Clipped(peak, float(theta[end]), outside_cap, p / p[0], deflection)


def _cap(theta, phase, beyond, order):
    """Values at theta (up to the cap's angle) that, with the moments of all beyond it, leave the least above `order`."""
    fewer = theta if len(theta) <= _INSIDE else np.linspace(0, theta[-1], _INSIDE)
    bumps = [legendre.moments(fewer, row, len(beyond) - 1)[order + 1:] for row in _bernstein(fewer)]
    aim = -(beyond[order + 1:] + phase[-1] * bumps[-1])
    free = basis.solve(aim[None], np.ones((1, len(aim))), np.array(bumps[:-1]))[0]
    values = np.append(free, phase[-1])
    return np.clip(sum(c * row for c, row in zip(values, _bernstein(theta), strict=True)), 0.0, phase)


def _bernstein(theta):
    """Bernstein's polynomials in (1 - cos theta) over its last value."""
    t = (np.sin(theta / 2) / math.sin(theta[-1] / 2)) ** 2
    return [math.comb(_DEGREE, n) * t**n * (1 - t) ** (_DEGREE - n) for n in range(_DEGREE + 1)]


def deflected(albedo, clip: Clipped, order) -> fourier.Propagator:
    """Third and later events of the clipped medium, where light between them is deflected as the peak does.

    Events are still those of the clipped phase function: what is deflected does not count.

    albedo : of the medium with the peak
    order : of the highest moment that scatters, at most that of the clip

    Returns Propagator in mean free paths of the clipped medium, as one of its albedo and moments would be without deflections

    Between events the order l decays as 1 + rate (1 - deflection_l) in place of 1.  In units of what that is at the last moment
    it is the solver's own matrix with something kept on its diagonal; only deflections that this moment does not see are lost.
    """
    if albedo == 0:
        return fourier.propagator(0.0, clip.moments[:order + 1])
    scattered, rate = clip.albedo(albedo), albedo * clip.peak / clip.extinction(albedo)  # of deflections, a mean free path
    stretch = 1 + rate * (1 - clip.deflection[-1])
    uncounted = rate * (clip.deflection - clip.deflection[-1]) / stretch  # to orders that are coupled to, but not scattered into
    stretched = fourier.propagator(scattered / stretch, clip.moments[:order + 1], uncounted=uncounted,
                               r_min=fourier.R_MIN * stretch, r_max=fourier.R_MAX * stretch)
    # T goes as stretch^3 for the volume, and once more for three events but two flights; r as 1/stretch
    return fourier.Propagator(scattered, clip.moments[:order + 1], stretched.k0 * stretch, stretched.log_r - math.log(stretch),
                              stretched.by_distance * stretch**3)


def solve(albedo, clip: Clipped, order) -> solution.Solution:
    """Third and later events of the clipped medium with the deflections between them, and an estimate of the solver's error.

    albedo : of the medium with the peak
    order : of the highest moment, at most; that of the clip
    """
    needed = legendre.order_needed(clip.moments)
    order = order if needed is None else min(order, needed)
    coarse, _ = solution.coarser(clip.moments, order)
    # a cap leaves as much far beyond the order as next to it: all moments count, as they do in a square over directions.  The
    # true error was then 0.1 to 2 times the estimate (fog, g = 0.95 .. 0.999, 24 to 64 orders); by the largest moment up to 5
    square = (2 * np.arange(len(clip.moments)) + 1) * clip.moments**2
    beyond, lost = (math.sqrt(square[n + 1:].sum()) for n in (order, coarse))
    cut = beyond / lost if lost > 0 else 0.0
    return solution.Solution(deflected(albedo, clip, order), partial(deflected, albedo, clip, coarse), cut)


def effect(clip: Clipped, solved: solution.Solution, reach) -> float:
    """What the deflections change: relative difference of the lobes of a point source where the peak is unscattered.

    clip, solved : of each other
    reach : mfp of the clipped medium, where the last places are

    Returns 1, root mean square over directions, then over places (distances logarithmic from 0.1 mfp, angles from the axis alike)
    """
    true = solved.coarse
    if clip.peak <= _NONE or true.albedo == 0:
        return 0.0
    unscattered = fourier.propagator(true.albedo, true.p)
    far = min(reach, *(_SOLVED * math.exp(propagation.log_r[-1]) for propagation in (unscattered, true)))
    r = np.geomspace(min(0.1, far / 2), far, _DISTANCES)[:, None]
    angles = (np.arange(_ANGLES) + 0.5) * math.pi / _ANGLES
    exact = point.coefficients(true, r, angles)
    apart = point.coefficients(unscattered, r, angles) - exact
    twice = np.concatenate([np.where(np.arange(l + 1) == 0, 1.0, 2.0) for l in range(true.order + 1)])
    return float(np.sqrt(((twice * apart**2).sum(axis=-1) / (twice * exact**2).sum(axis=-1)).mean()))
