"""A medium with one Henyey-Greenstein lobe for all wavelengths, which is all that pbrt and OpenPBR take, and what that loses."""

from dataclasses import dataclass

import numpy as np

from bakery.export.mixture import Loss, Mixture, source
from bakery.physics.medium.lobe_fits import best_hg
from bakery.physics.medium.lobes import Lobes
from bakery.store.tree import Group

STEEPEST = 0.99  # |g|: pbrt-v4 takes larger ones for this one (HenyeyGreenstein in its util/scattering.h)


@dataclass(frozen=True)
class OneLobe(Mixture):
    """A medium whose phase functions are one lobe, of the mean cosine of all wavelengths together, weighted by scattering."""

    best: float  # 1, g of the lobe which misdirects least of a single scattering of all wavelengths together; at most `STEEPEST`
    best_losses: tuple[Loss, ...]  # L of them, of that one

    @property
    def g(self) -> float:
        """1, of the lobe; at most `STEEPEST`."""
        return self.lobes.g[0]


def one_lobe(root: Group, name: str, within: float = 0.0) -> OneLobe:
    """An asset's medium with the mean cosine kept, not with the best fit of a single scattering.

    Light that is scattered many times depends on (1 - g) sigma_s alone, which the best fit of fog gets wrong by a factor of
    seven for a tenth less misdirected light (docs/lobes.md).

    Arguments and errors as of `bakery.export.mixture.source`.
    """
    values = source(root, name, within)
    lobe = Lobes((1.0,), (float(np.clip(values.g, -STEEPEST, STEEPEST)),), (0.0,))
    best = best_hg(values.medium.theta, values.mean, STEEPEST)
    return OneLobe(**vars(values.mixture(lobe)), best=best, best_losses=values.losses(Lobes((1.0,), (best,), (0.0,))))
