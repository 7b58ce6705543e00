"""Reflection of a layer without end by one Fourier order that scatters little, by iteration.

In the operators of `layer`, what comes back of light that goes down is R = M^(1/2) r M^(1/2) (M the cosines), and does not change
where more of the medium is put on top of it (Ambarzumian's invariance): with p and q the phase function between directions of one
hemisphere and of opposite ones,

    mu_i r_ij + r_ij mu_j = (q + p r M + M r p + M r q r M)_ij

Iterated from r = 0, each step adds an order of scattering, and the error falls by a, the largest moment times the albedo.
Extrapolated by Chebyshev's polynomials (semi-iteration, Golub and Varga 1961) it falls by (1 - sqrt(1 - a)) / (1 + sqrt(1 - a)),
in half to a third of the steps: orders of a forward peak take a few products of matrices, where modes take Jacobi rotations.  All
terms keep their digits at all cosines.  What nodes miss of a peak (`orders.unresolved`), light that goes straight on, is on the
diagonal of p; it belongs to the left side.
"""

from dataclasses import dataclass

import numpy as np

from bakery.physics.surfaces.cut import Cut
from bakery.physics.surfaces.layer import Layer, homogeneous

ITERATED = 1e-4  # of a tolerance: accuracy of orders that are iterated
FAINT = 0.9  # albedo of an order: below, iterations are quicker than modes
_DEPTH = 18.0  # of light that passes a layer and comes back e^-36 are below rounding
_STEPS = 40


@dataclass(frozen=True)
class Deep:
    """A layer that light of this order does not pass; as `layer.Layer`."""

    reflection: np.ndarray  # (N, N) upward light of light that enters at the top
    direct: np.ndarray  # (N,) zeros

    def scattered(self, mirror) -> tuple[np.ndarray, np.ndarray]:
        """Light (N, N) scattered upward at the top, under a boundary that sends shares (N,) back in; and downward: none."""
        nothing = np.zeros_like(self.reflection)
        if not mirror.any():
            return self.reflection, nothing
        result = np.linalg.solve(np.eye(len(mirror)) - self.reflection * mirror, self.reflection)
        return 0.5 * (result + result.T), nothing


def layer_of_order(without: Cut, order: int, parts, missed, directions, depth: float, accuracy: float) -> Layer | Deep:
    """A homogeneous layer, by modes or by iteration.

    without : the medium
    parts : even and odd part of its phase function, (N, N) each, without what nodes miss
    missed, accuracy : see `deep`; by modes where accuracy is 0
    directions : mu and flux (N,) of `nodes.Nodes`
    depth : optical depth, 0 to infinity
    """
    (even, odd), (mu, flux) = parts, directions
    ends = without.albedo * without.moments[order:].min(initial=0.0), without.albedo * without.moments[order:].max(initial=0.0)
    largest, layer = max(-ends[0], ends[1]), None
    if accuracy > 0 and largest <= FAINT and depth * (1 - largest) > _DEPTH:
        layer = deep((even, odd), missed, (mu, flux), without.albedo, ends, accuracy)
    return layer or homogeneous(even + np.diag(missed), odd + np.diag(missed), mu, flux, without.albedo, depth)


def deep(parts, missed, directions, albedo: float, ends, accuracy: float) -> Deep | None:
    """The layer, from parts of the phase function; None where too many steps would be needed.

    parts : (N, N) each, of the phase function, `orders.phase_matrices`, without what nodes miss
    missed : (N,) what nodes miss of a peak, `orders.unresolved`; 0 where they miss nothing
    directions : mu and flux (N,) of `nodes.Nodes`
    albedo : single-scattering albedo
    ends : of the moments times the albedo, the least, at most 0, and the largest, at least 0 and below 1
    accuracy : above 0, absolute, of R mu0 + mu R in units of radiance
    """
    (even, odd), (mu, flux) = parts, directions
    share = np.sqrt(0.5 * flux / mu)
    shares = share[:, None] * share
    weight = albedo * shares
    forward, backward = 0.5 * weight * (even + odd), 0.5 * weight * (even - odd)
    straight = 1 - albedo * share * share * missed
    sums = mu[:, None] * straight
    sums = sums + sums.T
    scale = sums / (2 * accuracy * shares)
    r, older, extrapolated = backward / sums, 0.0, 1.0
    low, high = ends  # between which the factors are by which parts of the error change in a step
    centred, half = 2 / (2 - low - high), (high - low) / (2 - low - high)
    halved, inverse = 0.5 * backward, 1 / sums
    for step in range(_STEPS):
        w = r * mu
        several = w.T @ halved
        several += forward
        several = several @ w
        change = several + several.T
        change += backward
        change *= inverse
        change -= r
        # what further steps add is at most a geometric series
        if float(np.abs(change * scale).max()) <= 1 - high:
            root = np.sqrt(mu)
            return Deep(root[:, None] * (r + change) * root, np.zeros(len(mu)))
        change *= centred
        change += r
        change -= older
        change *= extrapolated
        change += older
        r, older = change, r
        extrapolated = 1 / (1 - half * half * (0.25 * extrapolated if step else 0.5))
    return None
