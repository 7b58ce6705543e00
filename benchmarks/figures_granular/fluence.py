"""Fig. 9: where light leaves spheres about a beam source in an infinite packing."""

import math
from typing import NamedTuple

import numpy as np

from benchmarks.figures_goa import measures as of
from benchmarks.sizes import sized
from renderers.materials.grains.teleport import flights

from . import stand, walks

COUNT = sized(200_000, 1000)  # walkers of each method
NUMBERS = (32, 64)  # hits between which the growth of the squared distance is taken
FORWARD = math.cos(math.radians(10))
DRAWN, EXPONENTIAL, MEDIUM, MATCHED = "teleport", "teleport, exponential", "vpt", "vpt, sigma_t of walks"
METHODS = ("ept", DRAWN, EXPONENTIAL, MEDIUM, MATCHED)


class Material(NamedTuple):
    """walks : by method;  radii : (D,) of the detectors, in grain radii;  flight : lambda_t of Eq. 4, in grain radii"""

    walks: dict
    radii: np.ndarray
    flight: float


def measure(count=COUNT):
    return {"glass balls, f = 0.63": _measured(stand.asset(stand.BALLS), count),
            "snow, f = 0.6": _measured(stand.asset(stand.ROOT / "recipes" / "snow_pack.yaml"), count)}


def _measured(asset, count):
    grains, medium, middle = stand.endless(asset), asset.medium, len(asset.wavelength) // 2
    eq4, matched = (grains.unit * float(sigma[middle]) for sigma in (medium.sigma_t_mean_flight, medium.sigma_t_random_walk))
    radii, lobe = np.array([10.0, 7.5 / eq4, 15 / eq4]), (np.asarray(medium.theta), np.asarray(medium.phase)[middle])
    found = {"ept": walks.among_grains(grains, count, radii, NUMBERS),
             DRAWN: walks.among_grains(grains, count, radii, NUMBERS, law=flights(grains.aggregate)),
             EXPONENTIAL: walks.among_grains(grains, count, radii, NUMBERS, law=flights(grains.aggregate, exponential=True)),
             MEDIUM: walks.in_medium(eq4, *lobe, count, radii, NUMBERS),
             MATCHED: walks.in_medium(matched, *lobe, count, radii, NUMBERS)}
    return Material(found, radii, 1 / eq4)


def forward(cosine):
    """(n,) what each walker adds to the fluence within 10 degrees of the beam, over that of isotropic light."""
    return (cosine > FORWARD) / ((1 - FORWARD) / 2)


def elsewhere(cosine, others):
    """Share of the light that leaves at other inclinations, by steps of 15 degrees."""
    edges = np.linspace(0, math.pi, 13)
    ours, theirs = (np.histogram(np.arccos(np.clip(one, -1, 1)), edges)[0] / len(one) for one in (cosine, others))
    return 0.5 * float(np.abs(ours - theirs).sum())


def spread(walked):
    """(n,) what each walker adds to M, the growth of the mean square displacement a hit."""
    return (walked.squares[:, 1] - walked.squares[:, 0]) / (NUMBERS[1] - NUMBERS[0])


def more(values, others):
    """How much more the mean of `values` (n,) is than that of `others`, and its standard error, relative.

    Walker by walker: those of both laws of flights have the same random numbers.
    """
    ratio = values.mean() / others.mean()
    return ratio - 1, float(np.std(values - ratio * others)) / abs(others.mean()) / math.sqrt(len(values))


def _percent(found, error):
    return f"{100 * found:+.1f} ± {100 * error:.1f}"


def _against(values):
    """How much more (n,) values of each method are than those of `ept`."""
    return [_percent(*more(values[method], values["ept"])) for method in METHODS[1:]]


def tables(numbers):
    return {"fig9": _fluences(numbers), "fig9_elsewhere": _shares(numbers), "fig9_spread": _spreads(numbers)}


def _places(numbers):
    """Each material and detector: its first cells, and cosines of the walks by method."""
    for name, found in numbers.items():
        for k, radius in enumerate(found.radii):
            yield [name, f"{radius:.1f}", f"{radius / found.flight:.3g}"], \
                {method: found.walks[method].cosines[:, k] for method in METHODS}


PLACE = ["grains", "radius, R", "mean free paths"]


def _fluences(numbers):
    body = []
    for cells, by in _places(numbers):
        ahead = {method: forward(cosine) for method, cosine in by.items()}
        body.append(cells + [f"{ahead['ept'].mean():.2f}", *_against(ahead)])
    return of.table(PLACE + ["`ept`", *(f"`{method}`, % more" for method in METHODS[1:])], body)


def _shares(numbers):
    body = [cells + [f"{100 * elsewhere(by[method], by['ept']):.1f}" for method in METHODS[1:]] for cells, by in _places(numbers)]
    return of.table(PLACE + [f"`{method}`, %" for method in METHODS[1:]], body)


def _spreads(numbers):
    head = ["grains", "`ept`: M, R²", *(f"`{method}`, % more" for method in METHODS[1:]), "`ept`: grains met",
            *(f"`{method}`, % more" for method in METHODS[1:])]
    body = []
    for name, found in numbers.items():
        m = {method: spread(walked) for method, walked in found.walks.items()}
        met = {method: walked.hits[:, -1] for method, walked in found.walks.items()}
        error = m["ept"].std() / math.sqrt(len(m["ept"]))
        body.append([name, f"{m['ept'].mean():.2f} ± {error:.2f}", *_against(m), f"{met['ept'].mean():.2f}", *_against(met)])
    return of.table(head, body)


def draw(numbers):
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(len(numbers), 3, figsize=(9, 5), sharex=True, sharey="row", layout="constrained")
    edges = np.radians(np.linspace(0, 180, 31))
    share, middle = -np.diff(np.cos(edges)) / 2, np.degrees((edges[1:] + edges[:-1]) / 2)
    styles = {"ept": dict(color="black", lw=2.5, alpha=0.5), DRAWN: dict(color="C2"), EXPONENTIAL: dict(color="C1", ls="--"),
              MEDIUM: dict(color="C3"), MATCHED: dict(color="C0", ls=":")}
    for row, (name, found) in zip(axes, numbers.items()):
        for k, (ax, radius) in enumerate(zip(row, found.radii)):
            for method in METHODS:
                counts, _ = np.histogram(np.arccos(np.clip(found.walks[method].cosines[:, k], -1, 1)), edges)
                ax.plot(middle, counts / counts.sum() / share, label=method, **styles[method])
            ax.set_title(f"{name}: {radius:.1f} R, {radius / found.flight:.3g} mean free paths", fontsize=7)
            ax.set_yscale("log")
        row[0].set_ylabel("fluence, of isotropic light's")
    for ax in axes[-1]:
        ax.set_xlabel("inclination, degrees")
        ax.set_xticks([0, 45, 90, 135, 180])
    axes[0, 0].legend(fontsize=7)
    return figure
