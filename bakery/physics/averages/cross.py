"""Cross sections of single spheres and their means, at the first level of nodes where all means have converged, or at the last.

One quantity is beyond any grid: the absorption of spheres that hardly absorb.  Per unit of k it grows by some 2 % with every
decade that k falls (fog, 1e-4 .. 1e-8: docs/averages.md), because ever narrower resonances, down to a width of k x, take part.
Its error therefore counts relative to the absorption or to `0.01 tolerance` times the extinction, whichever is larger: an error
of 0.01 tolerance^2 in the albedo changes what a half-space of cloud reflects by less than the tolerance.  The relative change of
the absorption itself is kept beside it.
"""

import math
from dataclasses import dataclass

import numpy as np

from bakery.errors import StageError
from bakery.physics.averages.predicted import COATED, CROSS, FIRST_LEVEL
from bakery.physics.averages.spheres import Layers, terms
from bakery.physics.averages.work import cut, in_one

SHARE = 0.45  # of the tolerance, for a mean absorption
_CROSS = 0.1  # of the tolerance, for other cross sections: they cost little, and bound what the normalisation may be off


@dataclass(frozen=True)
class Cross:
    """Cross sections of one component at the nodes of a level, (L, R) in um^2, and relative errors (L,) of their means."""

    radius: np.ndarray
    weight: np.ndarray
    scattering: np.ndarray
    absorption: np.ndarray
    cosine: np.ndarray
    error: np.ndarray  # of extinction and scattering
    all_error: np.ndarray  # with absorption
    absorption_bias: np.ndarray  # of absorption alone


def cross_block(sphere, x):
    """(4, R): Q_sca, Q_abs and g of spheres x (R,), and Q_ext; sphere: an index, or `spheres.Layers`."""
    out = np.zeros((4, len(x)))
    if isinstance(sphere, Layers):
        from bakery.physics.mie.coated import coated_efficiency_block

        coated_efficiency_block(sphere.core, sphere.shell, sphere.inner(x), x, out[3], out[0], out[1], np.empty(len(x)), out[2])
    else:
        from bakery.physics.mie.coefficients import cross_section_block

        cross_section_block(complex(sphere), x, out[3], out[0], out[1], out[2])
    return out


def cross_sections(component, nodes, wavelength, k, tolerance, work):
    """The component's cross sections at the first level where all its means have converged at all wavelengths, or at the last."""
    r = nodes.fixed()[0]
    by_level = {None: _spheres(component, r, k, work)}
    means = []
    for level in range(nodes.levels):
        if nodes.refinable:
            by_level[level] = _spheres(component, nodes.fresh(level)[0], k, work)
        radius, weight = nodes.whole(level)
        values = _assembled(nodes, by_level, level)
        means.append(np.stack([np.sum(values[0] * weight, axis=-1), np.sum(values[1] * weight, axis=-1)]))
        error, absorption, alone = _halving(means, tolerance) if nodes.refinable else np.zeros((3, len(k)))
        if not nodes.refinable or (
                level >= FIRST_LEVEL and (error <= _CROSS * tolerance).all() and (absorption <= SHARE * tolerance).all()):
            break
    dark = np.flatnonzero(means[-1][0] <= 0)
    if len(dark):
        raise StageError(
    f"{component.name} at {wavelength[dark[0]]:g} um does not scatter: its index is that of the host, or it is too "
    "small for double precision; another material or host would do")
    return Cross(radius, weight, values[0], values[1], values[2], error, np.maximum(error, absorption), alone)


def _halving(means, tolerance):
    """(3, L): relative change of the mean cross sections in the last two halvings, the older one halved.

    Rows: the larger of extinction and scattering; absorption, over at least 0.01 tolerance of the extinction; absorption alone.
    """
    if len(means) < 3:
        return np.full((3, means[0].shape[-1]), math.inf)
    s, a = means[-1]
    scale = np.stack([s + a, s, np.maximum(a, 0.01 * tolerance * (s + a)), a])
    change = np.zeros_like(scale)
    for new, old, share in ((means[-1], means[-2], 1.0), (means[-2], means[-3], 0.5)):
        ds, da = new - old
        step = share * np.abs(np.stack([ds + da, ds, da, da]))
        change = np.maximum(change, np.divide(step, scale, out=np.zeros_like(step), where=scale > 0))
    return np.stack([change[:2].max(axis=0), change[2], change[3]])


def _spheres(component, radius, k, work):
    """(3, L, R): scattering and absorption cross sections (um^2) and mean cosine of single spheres."""
    if not len(radius):
        return np.zeros((3, len(k), 0))
    tasks, seconds = [], []
    x = np.asarray(k)[:, None] * radius
    cost = terms(x) * (CROSS if component.coat is None else COATED)
    whole = np.sum(cost, axis=1)
    for sphere, at, by_sphere, of_all in zip(component.spheres(k), x, cost, whole):
        for a, b in [(0, len(at))] if in_one(of_all) else cut(by_sphere):
            tasks.append((sphere, at[a:b]))
            seconds.append(float(np.sum(by_sphere[a:b])))
    work.charge(float(np.sum(whole)), component.name)
    blocks = work.run(cross_block, tasks, seconds)
    work.report(work.seconds, None)
    q = np.concatenate(blocks, axis=1).reshape(4, len(k), len(radius))
    area = math.pi * radius**2
    return np.stack([q[0] * area, q[1] * area, q[2]])


def _assembled(nodes, by_level, level):
    """Values of all nodes of a level by ascending radius, from those of the levels."""
    radius = [nodes.fixed()[0]]
    values = [by_level[None]]
    if nodes.refinable:
        for j in range(level + 1):
            radius.append(nodes.fresh(j)[0])
            values.append(by_level[j])
    order = np.argsort(np.concatenate(radius), kind="stable")
    return np.concatenate(values, axis=2)[:, :, order]
