"""A medium with one Henyey-Greenstein lobe for all wavelengths, which is all that pbrt and OpenPBR take, and what that loses."""

from __future__ import annotations

import re
from dataclasses import asdict, dataclass

import numpy as np

from bakery.export import medium_of, scattering_of
from bakery.physics.medium.lobe_fits import best_hg
from bakery.physics.medium.lobes import Lobes, Misfit, misfit
from bakery.physics.medium.phase import mean_cosine
from bakery.store.tree import Group

STEEPEST = 0.99  # |g|: pbrt-v4 takes larger ones for this one (HenyeyGreenstein in its util/scattering.h)
USELESS = 0.3  # of the light to another angle: what is said first


@dataclass(frozen=True)
class Loss:
    """What one lobe loses at one wavelength.

    Attributes
    ----------
    misfit : of the lobe against the phase function there
    reduced : 1, relative error of the reduced scattering coefficient (1 - g) sigma_s, which media that scatter often depend on
    """

    misfit: Misfit
    reduced: float


@dataclass(frozen=True)
class OneLobe:
    """A medium whose phase functions are one lobe.

    Attributes
    ----------
    um : (L,) um
    sigma_a, sigma_s : (L,) 1/m; without the unscattered (delta) transmission of grains, of which `delta` is the largest share
    g : 1, mean cosine of all wavelengths together, weighted by scattering; at most `STEEPEST`
    losses : L of them
    best : that of the lobe which misdirects least of a single scattering of all wavelengths together; at most `STEEPEST`
    best_losses : L of them, of that one
    """

    um: np.ndarray
    sigma_a: np.ndarray
    sigma_s: np.ndarray
    g: float
    losses: tuple[Loss, ...]
    best: float
    best_losses: tuple[Loss, ...]
    delta: float

    @property
    def sigma_t(self) -> np.ndarray:
        """(L,) 1/m."""
        return self.sigma_a + self.sigma_s

    @property
    def misdirected(self) -> float:
        """1, largest share of the scattered light that goes to another angle."""
        return max(loss.misfit.misdirected for loss in self.losses)

    def useless(self) -> list[str]:
        """What is to be said first."""
        if self.misdirected <= USELESS:
            return []
        return [f"one lobe sends {100 * self.misdirected:.2g} % of the light to another angle; thick media are about right, "
                "thin ones and halos around lamps are not"]

    def as_dicts(self) -> list[dict]:
        """The losses for machines (`--json`)."""
        return [{"wavelength": um, "g_of_file": self.g, "reduced": loss.reduced, **asdict(loss.misfit)}
                for um, loss in zip(self.um.tolist(), self.losses, strict=True)]


def one_lobe(root: Group, name: str) -> OneLobe:
    """An asset's medium with the mean cosine kept, not with the best fit of a single scattering.

    Light that is scattered many times depends on (1 - g) sigma_s alone, which the best fit of fog gets wrong by a factor of
    seven for a tenth less misdirected light (docs/lobes.md).

    Parameters
    ----------
    root : the asset's tree
    name : of the asset, for messages

    Raises
    ------
    AssetError : there is no medium
    """
    medium = medium_of(root, name)
    rest = scattering_of(medium)
    share = rest.sigma_s / rest.sigma_s.sum() if rest.sigma_s.any() else np.full(len(rest.sigma_s), 1 / len(rest.sigma_s))
    own = mean_cosine(rest.theta, rest.phase)
    g, best = float(np.clip(share @ own, -STEEPEST, STEEPEST)), best_hg(rest.theta, share @ rest.phase, STEEPEST)

    def losses(value: float) -> tuple[Loss, ...]:
        lobe = Lobes((1.0,), (value,), (0.0,))
        return tuple(Loss(misfit(rest.theta, row, lobe), float((1 - value) / (1 - mean) - 1))
                     for row, mean in zip(rest.phase, own, strict=True))

    return OneLobe(root["wavelength"].data, medium["sigma_a"].data, rest.sigma_s, g, losses(g), best, losses(best),
                   float(rest.delta.max()))


def identifier(name: str) -> str:
    """A name of ASCII letters, digits and _, not starting with a digit: what every format takes."""
    plain = re.sub(r"[^A-Za-z0-9_]", "_", name) or "_"
    return f"_{plain}" if plain[0].isdigit() else plain
