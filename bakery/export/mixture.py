"""A medium with the same few lobes at all wavelengths, as production renderers take it, and what that loses."""

import math
import re
from dataclasses import asdict, dataclass

import numpy as np

from bakery.export.medium import Scattering, medium_of, scattering_of, without_peak
from bakery.physics.medium.lobes import Lobes, Misfit, misfit
from bakery.physics.medium.phase import mean_cosine
from bakery.store.tree import Group

USELESS = 0.3  # of the light to another angle: what is said first
# Error of the reduced scattering up to which thick media are about right, and above which it is said first.  What a thick body
# reflects and lets through varies more slowly than its reduced scattering: about as the square root where it absorbs little.
RIGHT, WRONG = 0.1, 0.2
WIDEST = math.radians(10)  # light that is deflected by more always counts as scattered


@dataclass(frozen=True)
class Loss:
    """What the lobes lose at one wavelength."""

    misfit: Misfit  # of the lobes against the phase function of the light that counts as scattered
    # 1, relative error of the reduced scattering coefficient (1 - g) sigma_s, which media that scatter often depend on
    reduced: float
    unscattered: float  # 1, share of the scattered light in the forward peak, if that counts as unscattered

    @property
    def misdirected(self) -> float:
        """1, share of all scattered light that goes to another angle; what counts as unscattered aside."""
        return (1 - self.unscattered) * self.misfit.misdirected


@dataclass(frozen=True)
class Mixture:
    """A medium of lobes."""

    um: np.ndarray  # (L,) um
    # sigma_a, sigma_s: (L,) 1/m; without the unscattered (delta) transmission of grains, of which `delta` is the largest share,
    # and without the forward peak within `within` rad, if one was taken as unscattered
    sigma_a: np.ndarray
    sigma_s: np.ndarray
    lobes: Lobes  # for all wavelengths
    losses: tuple[Loss, ...]  # L of them
    delta: float
    within: float

    @property
    def sigma_t(self) -> np.ndarray:
        """(L,) 1/m."""
        return self.sigma_a + self.sigma_s

    @property
    def misdirected(self) -> float:
        """1, largest share of the scattered light that goes to another angle."""
        return max(loss.misdirected for loss in self.losses)

    @property
    def unscattered(self) -> float:
        """1, largest share of the scattered light that is in a forward peak which counts as unscattered."""
        return max(loss.unscattered for loss in self.losses)

    @property
    def reduced(self) -> tuple[float, float]:
        """um and 1: the wavelength where the relative error of the reduced scattering coefficient is largest, and that error."""
        return max(zip(self.um.tolist(), (loss.reduced for loss in self.losses), strict=True), key=lambda pair: abs(pair[1]))

    def useless(self) -> list[str]:
        """What is to be said first."""
        lines, (um, error) = [], self.reduced
        if self.misdirected > USELESS:
            lobes = "one lobe sends" if len(self.lobes.g) == 1 else "the lobes send"
            right = ("thick media are about right, thin ones and halos around lamps are not" if abs(error) <= RIGHT else
                     "thin media and halos around lamps are not right")
            lines.append(f"{lobes} {100 * self.misdirected:.2g} % of the light to another angle; {right}")
        if abs(error) > WRONG:
            lines.append(f"reduced scattering is off by {100 * error:+.2g} % at {um:g} um, and thick media with it")
        return lines

    def remarks(self) -> list[str]:
        """Lines for a comment in the file: what stands for the phase functions, and what that loses."""
        lobes = ("One Henyey-Greenstein lobe stands" if len(self.lobes.g) == 1 and not any(self.lobes.alpha)
                 else "Lobes of Henyey and Greenstein and of Draine stand" if any(self.lobes.alpha)
                 else "Two Henyey-Greenstein lobes stand")
        lines = [f"{lobes} for the phase functions: up to {100 * self.misdirected:.2g} % of the light", "goes to another angle."]
        if self.within:
            lines += [f"Up to {100 * self.unscattered:.2g} % of the scattered light is deflected by less than "
                      f"{math.degrees(self.within):.3g} degrees.",
                      "It counts as unscattered: sigma_s and sigma_t are smaller by it."]
        return lines

    def as_dicts(self) -> list[dict]:
        """The losses for machines (`--json`)."""
        return [{"wavelength": um, "g_of_file": self.lobes.mean_cosine, "reduced": loss.reduced} | asdict(loss.misfit)
                | {"misdirected": loss.misdirected, "unscattered": loss.unscattered, "within": self.within}
                for um, loss in zip(self.um.tolist(), self.losses, strict=True)]


@dataclass(frozen=True)
class Source:
    """What lobes are fitted to."""

    um: np.ndarray  # (L,) um
    sigma_a: np.ndarray  # (L,) 1/m
    medium: Scattering  # of the light that counts as scattered
    mean: np.ndarray  # (A,) 1/sr, its phase functions averaged by sigma_s
    g: float  # 1, mean cosine of that
    reduced: np.ndarray  # (L,) 1/m, reduced scattering of the asset

    def losses(self, lobes: Lobes) -> tuple[Loss, ...]:
        """What lobes lose, at each wavelength."""
        medium = self.medium
        reduced = (1 - lobes.mean_cosine) * medium.sigma_s
        off = np.divide(reduced, self.reduced, out=np.ones_like(reduced), where=self.reduced > 0) - 1
        return tuple(Loss(misfit(medium.theta, row, lobes), float(error), float(peak))
                     for row, error, peak in zip(medium.phase, off, medium.peak, strict=True))

    def mixture(self, lobes: Lobes) -> Mixture:
        """The medium with these lobes."""
        return Mixture(self.um, self.sigma_a, self.medium.sigma_s, lobes, self.losses(lobes), float(self.medium.delta.max()),
                       self.medium.within)


def source(root: Group, name: str, within: float = 0.0) -> Source:
    """An asset's medium for fits.

    within : rad, light in a forward peak of this width counts as unscattered (`without_peak`); 0: none

    Raises AssetError : there is no medium
    """
    group = medium_of(root, name)
    whole = scattering_of(group)
    without = without_peak(whole, int(np.searchsorted(whole.theta, within))) if within else whole
    scattered = without.sigma_s
    share = scattered / scattered.sum() if scattered.any() else np.full(len(scattered), 1 / len(scattered))
    return Source(root["wavelength"].data, group["sigma_a"].data, without, share @ without.phase,
                  float(share @ mean_cosine(without.theta, without.phase)),
                  (1 - mean_cosine(whole.theta, whole.phase)) * whole.sigma_s)


def identifier(name: str) -> str:
    """A name of ASCII letters, digits and _, not starting with a digit: what every format takes."""
    plain = re.sub(r"[^A-Za-z0-9_]", "_", name) or "_"
    return f"_{plain}" if plain[0].isdigit() else plain
