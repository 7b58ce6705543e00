"""Rules that the groups of several stages keep: `verify` and the store name the ones that are broken."""

from collections.abc import Iterable

import numpy as np


def angles(theta) -> Iterable[str]:
    """Whether theta (A,) ascends from exactly 0 to exactly pi."""
    if not np.isfinite(theta).all() or len(theta) < 2 or theta[0] != 0 or theta[-1] != np.pi or not (np.diff(theta) > 0).all():
        yield "theta does not ascend from 0 to pi"


def phase_function(theta, f, others=(None, None, None)) -> Iterable[str]:
    """Broken rules of a phase function (L, A) and of s12, s33, s34 where they are given."""
    from bakery.physics.medium import phase

    off = np.abs(phase.phase_integral(theta, f) - 1).max()
    if not off <= 1e-12:
        yield f"phase integrates to 1 with an error of {off:.1g}, not 1e-12"
    # equality for a single sphere: leave room for rounding
    polarised = all(value is not None for value in others)
    if polarised and (sum(value**2 for value in others) > f**2 * (1 + 1e-9)).any():
        yield "s12^2 + s33^2 + s34^2 exceeds s11^2"
