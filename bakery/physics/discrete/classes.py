"""Size classes: a distribution of radii as a few radii, each with mean cross sections and a mean phase function.

A renderer of separate particles needs the cross sections and the phase function of each, and has no room for the exact radius of
1e8 of them.  Classes are narrow where the particles of a medium scatter (ratios of radii of 1.25, within which cross sections
have a relative standard deviation of about 13 %) and wide in the tails, and their averages are those of the very particles that
they stand for, so that the sum over classes is the continuous medium.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from bakery.physics.averages import Aim, Component, Rays, averages, expected
from bakery.physics.averages.choice import at_once
from bakery.physics.averages.spheres import SERIES
from bakery.physics.medium import phase
from bakery.physics.sizes.distributions import Part, Population
from bakery.physics.tasks import in_turn

MOST = 64  # classes of all components together
RATIO = 1.25  # of the edges of a class
_SMALL, _LARGE = 0.01, 1e-3  # share of the number below, and of r^4 above, that the outermost classes take with their own range
_LEAST = 1e-15  # share of the number that counts as none
# Tolerance above which averages begin with few sizes and angles.  Eight classes of snowflakes asked for at 30 % took 11.6 s and
# said 4.9 %; begun with fewer 4.1 s, and 14 %.  At 10 % 5 degrees of a class are off by 5 % in place of 2, which scenes in light
# from one direction were not measured with
_LOOSE = 0.2


@dataclass(frozen=True)
class Classes:
    """Size classes of one component, K of them, by ascending radius."""

    edge: np.ndarray  # (K + 1,) um; equal to the radius where there is one size
    radius: np.ndarray  # (K,) um, root mean square radius, as float32 holds it
    share: np.ndarray  # (K,) of the component's number, adds up to 1
    sizes: tuple[Population, ...]  # the distribution within each class


@dataclass(frozen=True)
class Optics:
    """What the particles of one component's classes do to light."""

    # extinction, scattering: (L, K) um^2, means over the class
    extinction: np.ndarray
    scattering: np.ndarray
    spread: np.ndarray  # (L, K) 1, relative variance of the extinction within the class
    phase: np.ndarray  # (L, K, A) 1/sr float32, averaged by scattering, integral 1 to 1e-6
    error: np.ndarray  # (L, K) 1, relative error of the means, and of the phase function integrated over the sphere


def classes(population: Population, most: int = MOST, exactly: int | None = None) -> Classes:
    """The classes of a population, at most `most`; `exactly` so many, if the population has as many sizes."""
    edge = _edges(population, most, exactly)
    cuts = [_cut(population, a, b, k == 0, k == len(edge) - 2) for k, (a, b) in enumerate(zip(edge[:-1], edge[1:]))]
    kept = [k for k, (share, _) in enumerate(cuts) if share > _LEAST]
    share = np.array([cuts[k][0] for k in kept])
    sizes = tuple(cuts[k][1] for k in kept)
    radius = np.array([math.sqrt(of.moment(2)) for of in sizes], np.float32).astype(float)
    # a class without particles goes to the one below it; the first one's lower edge stays
    edge = np.append(edge[kept], edge[-1])
    edge[0] = min(edge[0], radius[0])
    edge[-1] = max(edge[-1], radius[-1])
    return Classes(edge, radius, share / share.sum(), sizes)


def _edges(population, most, exactly):
    """Edges of the classes, um; (2,) equal ones for a single size."""
    single = sorted({part.law.radius for part in population.parts if part.law.discrete})
    if population.single and len(single) <= (exactly or most):
        middle = [math.sqrt(a * b) for a, b in zip(single, single[1:])]
        return np.array([single[0], *middle, single[-1]])
    reach = [(max(part.law.reach()[0], part.lower), min(part.law.reach()[1], part.upper)) for part in population.parts]
    first, last = min(a for a, _ in reach), max(b for _, b in reach)
    low, high = _quantile(population, 0, _SMALL, first, last), _quantile(population, 4, 1 - _LARGE, first, last)
    count = exactly or min(most, max(1, math.ceil(math.log(high / low) / math.log(RATIO))))
    edge = np.geomspace(low, high, count + 1) if high > low else np.array([low, high])
    edge[0], edge[-1] = first, last
    return edge


def _quantile(population, power, share, low, high):
    """Radius (um) below which a share of the r^power-weighted number lies."""
    whole = population.moment(power)
    a, b = math.log(low), math.log(high)
    for _ in range(60):
        middle = 0.5 * (a + b)
        below = math.fsum(part.share * part.moment(power, upper=math.exp(middle)) for part in population.parts)
        a, b = (a, middle) if below >= share * whole else (middle, b)
    return math.exp(b)


def _cut(population, low, high, first, last):
    """Share of the number between two edges, and the distribution there; the outermost classes have no end."""
    low, high = 0.0 if first else low, math.inf if last else high
    parts = []
    for part in population.parts:
        lower, upper = max(part.lower, low), min(part.upper, high)
        if part.law.discrete:
            share = part.share if low <= part.law.radius < high else 0.0
        elif lower < upper:
            share = part.share * part.law.moment(0, lower, upper) / part.law.moment(0, part.lower, part.upper)
        else:
            share = 0.0
        if share > _LEAST:
            parts.append((part.law, share, lower, upper))
    total = math.fsum(share for _, share, *_ in parts)
    return total, Population(tuple(Part(law, share / total, a, b) for law, share, a, b in parts))


def per_component(components: int) -> int:
    """Classes that each of so many components may have."""
    return max(1, MOST // components)


def spheres(components: Sequence[Component], by_component: Sequence[Classes]) -> list[Component]:
    """Every class as a component of its own, in order."""
    return [replace(of, name=f"{of.name} {radius:.3g} um", sizes=sizes)
            for of, sizes_of in zip(components, by_component, strict=True)
            for radius, sizes in zip(sizes_of.radius, sizes_of.sizes)]


def optics(components: Sequence[Component], by_component: Sequence[Classes], wavelength, host, tolerance: float,
           map: Callable = in_turn,
           report: Callable[[float, float | None], None] = lambda seconds, error: None, *, rays: Rays = SERIES,
           remember: Callable = at_once) -> tuple[np.ndarray, list[Optics]]:
    """Averages over the particles of each class.

    Parameters
    ----------
    components, by_component : kinds of spheres, and the classes of each
    wavelength, host : (L,) um in vacuum, (L,) real index
    tolerance : largest relative error of a class's mean cross sections and of the integral of its phase function
    map, report, rays, remember : as in `bakery.physics.averages.averages`

    Returns
    -------
    theta : (A,) rad
    optics : one for each component
    """
    theta, averaged = averages(spheres(components, by_component), wavelength, host, _aim(tolerance, rays),
                               map, report, remember=remember)
    out, start = [], 0
    for classes_of in by_component:
        of = averaged[start:start + len(classes_of.radius)]
        start += len(of)
        extinction = [np.array(average.scattering + average.absorption) for average in of]
        mean = np.stack([np.sum(c * average.weight, axis=-1) for c, average in zip(extinction, of)], axis=1)
        square = np.stack([np.sum(c * c * average.weight, axis=-1) for c, average in zip(extinction, of)], axis=1)
        table, _ = phase.normalised(theta, np.stack([average.elements[:, 0] for average in of], axis=1))
        out.append(Optics(mean, np.stack([np.sum(average.scattering * average.weight, axis=-1) for average in of], axis=1),
                          np.maximum(square / mean**2 - 1, 0.0), table.astype(np.float32),
                          np.stack([average.error for average in of], axis=1)))
    return theta, out


def _aim(tolerance, rays):
    return Aim(tolerance, integrated=True, rays=rays, sparse=tolerance > _LOOSE, peaks=True)


def predicted(components, by_component, wavelength, host, tolerance, *, rays: Rays = SERIES,
              remember: Callable = at_once):
    """What `optics` will take (`bakery.physics.averages.predicted.Prediction`)."""
    return expected(spheres(components, by_component), wavelength, host, _aim(tolerance, rays),
                    remember=remember)[0]
