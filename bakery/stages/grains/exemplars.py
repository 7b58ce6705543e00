"""Exemplar grains of a recipe: sizes that stand for a law, paths that wavelengths share, meshes, what follows rays in them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from bakery.errors import StageError

CELLS = 180  # of the phase function
_CLASSES = 8  # radii that stand for a continuous law
_QUANTILES = 4096


def size_classes(law) -> tuple[np.ndarray, np.ndarray]:
    """Radii over their mean (S,) and shares by number (S,) that stand for a law of radii.

    A list is taken as it is.  A log-normal law is cut into classes of equal cross section, each with its mean radius by cross
    section and so many grains that it keeps that cross section: light meets classes as it meets the law, and finds its volume.
    """
    from bakery.physics.packing import radii

    if law.distribution == "equal":
        return np.ones(1), np.ones(1)
    if law.distribution == "list":
        share, radius = (np.array(column, float) for column in zip(*law.of, strict=True))
        return radius / (share @ radius), share / share.sum()
    r = radii.lognormal(law.sigma, _QUANTILES)
    area = np.cumsum(r**2)
    which = np.minimum((_CLASSES * (area - 0.5 * r**2) / area[-1]).astype(int), _CLASSES - 1)
    parts = [r[which == k] for k in range(_CLASSES)]
    radius = np.array([np.sum(p**3) / np.sum(p**2) for p in parts])
    share = np.array([np.sum(p**2) for p in parts]) / radius**2
    return radius, share / share.sum()


@dataclass(frozen=True)
class Trace:
    """Paths that several wavelengths and sizes share.

    Attributes
    ----------
    surface : of the grain, `bakery.physics.grains.surface`
    mu : (C,) 1/R
    rows : wavelengths that it serves
    channel : (S, rows) channels of the radii and wavelengths
    white : the channel in which nothing is absorbed
    """

    surface: object
    mu: np.ndarray
    rows: tuple[int, ...]
    channel: np.ndarray
    white: int


def traces(component: Mapping, radii, wavelengths: int, apart: float) -> list[Trace]:
    """What has to be traced for a component whose bounding spheres have `radii` (S,) m; near indices (`apart`) count as one."""
    from bakery.physics.grains import surface

    every, sizes = tuple(range(wavelengths)), len(radii)
    if component["type"] == "dielectric":
        made, real = [], component["index"].real
        for eta, rows in _alike(real, 0.0 if is_ball(component) else apart):
            mu, which = np.unique(np.append(0.0, np.outer(radii, component["absorption"][list(rows)])), return_inverse=True)
            made.append(Trace(surface.dielectric(eta, component["roughness"]), mu, rows,
                              which.ravel()[1:].reshape(sizes, len(rows)), int(which.ravel()[0])))
        return made
    if component["type"] == "diffuse":
        values, which = np.unique(np.append(1.0, component["reflectance"]), return_inverse=True)
        made = surface.diffuse(values)
    else:
        values, which = np.unique(np.append(complex(math.inf, 0), component["index"]), return_inverse=True)
        made = surface.conductor(values, component["roughness"])
    channel = np.broadcast_to(which.ravel()[1:], (sizes, wavelengths))
    return [Trace(made, np.zeros(len(values)), every, channel, int(which.ravel()[0]))]


def is_ball(component: Mapping) -> bool:
    """Whether a closed form knows the answer."""
    return component["shape"]["type"] == "sphere" and component["roughness"] == 0


def _alike(index, apart: float) -> list[tuple[float, tuple[int, ...]]]:
    """Indices that stand for those within `apart` above the lowest of them, and the wavelengths of each."""
    groups, order = [], np.argsort(index, kind="stable")
    for row in order.tolist():
        if groups and index[row] - index[groups[-1][0]] <= apart:
            groups[-1].append(row)
        else:
            groups.append([row])
    return [(0.5 * (float(index[rows[0]]) + float(index[rows[-1]])), tuple(rows)) for rows in groups]


def nodes() -> tuple[np.ndarray, np.ndarray]:
    """Angles of the table (A,) and the edges of their cells (A + 1,), at the mean cosines of neighbours."""
    theta = np.linspace(0.0, np.pi, CELLS + 1)
    v = 2 * np.sin(theta / 2) ** 2
    edges = np.concatenate([[0.0], 2 * np.arcsin(np.sqrt((v[1:] + v[:-1]) / 4)), [np.pi]])
    return theta, edges


def mesh_of(component: Mapping, triangles: int):
    """The exemplar; StageError says which grain cannot be made, and why."""
    from bakery.physics.shapes import build as shapes

    try:
        return shapes.build(component["shape"], triangles)
    except ValueError as error:
        what = component["file"] or component["shape"]["type"]
        raise StageError(f"grain {component['name']}: {what}: {error}") from None


def tracer_of(grain, trace: Trace, depth: int, engine: str, tree=None):
    """What follows rays through a grain, or None where a closed form knows the answer."""
    if grain.analytic == "sphere":
        if trace.surface.roughness == 0:
            return None
        from bakery.physics.grains.balls import BallWalker

        return BallWalker(trace.surface, trace.mu, events_max=depth)
    if engine == "mitsuba":
        from bakery.physics.grains.mitsuba_walk import MitsubaWalker

        return MitsubaWalker(grain.vertices, grain.faces, trace.surface, trace.mu, events_max=depth)
    from bakery.physics.grains.walk import Walker

    return Walker(tree, trace.surface, trace.mu, events_max=depth)
