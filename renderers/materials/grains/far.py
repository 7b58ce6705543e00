"""Grains whose boundary is a baked surface far from the camera: paths that come in from the open are turned there.

In the open are paths of the camera, of surfaces of the scene, and those that such a boundary has turned.  Where one comes into
the mesh of grains it is turned by the baked surface with a chance that the distance of that place to the camera gives
(`renderers.transport.far.chance`), and else goes on as without it, from grain to grain.  Paths that come from grains, or from the
medium that stands for them, are not asked: among grains there is no surface, and light that leaves those that are near and comes
to far ones meets the grains themselves, which brings the same light later.

The surface is that of all grains whose centres lie below it, those that stick out with it.  So a path that it has turned meets
none of these: grains are ahead of it only where it comes into a mesh again, from where they stick out on.
"""

from typing import NamedTuple

import numpy as np

from renderers.materials.grains import material
from renderers.materials.grains._entries import Boundary
from renderers.materials.surface import far, lobes, onset
from renderers.mitsuba import layers
from renderers.mitsuba.shapes import Shape
from renderers.scene import budget, meshes
from renderers.transport import wavefront
from renderers.transport.far import chance

_NEVER, _LEAST = 1e30, 1e-30  # m, distances that no place has


class Surface(NamedTuple):
    """The boundary of a body's grains.

    boundary : of their mesh;  reach : m, by which grains stick out of it
    lobes : `renderers.materials.surface.lobes.Lobes`, per wavelength
    camera : (3,) m;  near : m, distance to it up to which no path is turned; from twice that on all are
    """

    boundary: Boundary
    reach: float
    lobes: lobes.Lobes
    camera: np.ndarray
    near: float

    def chance(self, point):
        """That a path is turned at points (n, 3) m."""
        distance = np.sqrt(np.sum((point - self.camera) ** 2, axis=1))
        return chance(np.maximum(distance, _LEAST), min(max(self.near, _LEAST), _NEVER), np)

    def beside(self, t, direction, normal):
        """Distances (n,) m, from which on grains can stick out of the mesh where rays come in at distances t (n,)."""
        cosine = np.abs(np.sum(direction * normal, axis=1))
        return np.maximum(t - self.reach / np.maximum(cosine, 1e-6), 0.0)


# ---- the surfaces of a scene


def surfaces_of(scene, world, assets, grains, meshes, method):
    """`Surface` of each body, None where no path of a picture would be turned; and sentences about them.

    grains, meshes : as of `methods.of`;  method : `declaration.GrainMethod`;  UsageError where a body cannot be a surface
    """
    whole, listed, reasons, reached = world.whole or world, [], [], False
    for number, (asset, packed, (vertices, faces)) in enumerate(zip(assets, grains, meshes, strict=True)):
        entry = scene.values.materials[number]
        if fault := unfit(entry, asset):
            raise scene.wrong(f"materials[{number}].method", f"found {entry.method}, but {fault}; use ept+vpt, or an asset with "
                              "such a surface")
        begins = onset_of(scene, number, asset, whole, method)
        layer = layers.load(str(asset.path), 0)
        corners = np.array(np.meshgrid(*np.array([vertices.min(axis=0), vertices.max(axis=0)]).T)).reshape(3, -1).T
        reached |= begins.near < np.max(np.linalg.norm(corners - world.camera.origin, axis=1))
        listed.append(Surface(Boundary.of(vertices, faces), material.radius_of(packed), lobes.of_layer(layer),
                              np.asarray(world.camera.origin, float), begins.near))
        reasons += [onset.in_words(number, begins, "ept+vpt", "its grains"),
                    f"materials[{number}]: {method.leaves_out}",
                    f"materials[{number}]: the reflectance of its surface is looked up within {100 * layer.error:.2g} %, at "
                    "angles to 89.9 degrees"]
    return (tuple(listed), reasons) if reached else (None, reasons[::3])


def unfit(entry, asset) -> str:
    """Why an asset's surface is not that of the grains of an entry; "" where it is."""
    if entry.fraction is not None or entry.mixture is not None:
        return "its surface is that of grains that are the same everywhere"
    if "surface" not in asset.stages:
        return "no surface is baked"
    if asset.surface.get("thickness") is not None:
        return "its surface is that of a layer, and the mesh is full"
    index = float(np.asarray(asset.surface["index"]).ravel()[0])
    return "" if index == 1 else f"its surface is baked under a boundary of index {index:g}, and grains have none"


def onset_of(scene, number, asset, world, method) -> onset.Onset:
    """From where on an entry is its surface, by how far light spreads and how wide grains are in pixels; method : as above"""
    near_error = method.error(scene.values.tolerance or budget.DEFAULT)
    vertices, faces = meshes.of_entry(scene, number)
    shape = Shape("", vertices, faces, np.array([vertices.min(axis=0), vertices.max(axis=0)]), 1.0, True)
    boundary = Boundary.of(vertices, faces)
    seen = far.seen(world, shape.box, lambda origin, direction: _first(world, boundary, origin, direction))
    single = np.minimum(2 * material.largest_of(asset) / np.maximum(seen.width, _LEAST), 1.0)
    look = onset.Look(far.bent(shape, far.spread(asset)), far.mean_distance(asset), seen, single)
    return onset.begins(scene, number, look, near_error)


def _first(world, boundary, origin, direction):
    """Distances (n,) m to a mesh, and whether rays meet it before any surface."""
    t, _ = boundary.entries(origin, direction, world.trace(origin, direction, np.inf))
    return t, np.isfinite(t)


# ---- paths


def meetings(surfaces, paths, at, limit):
    """Of paths `at` (m,) in the open, before limit (m,) m: distances (m, bodies) at which they come into each body, and at which
    they are turned there, inf where they are not; and (m,) where first grains can be ahead."""
    origin, direction = paths.origin[at], paths.direction[at]
    comes_in, first = np.full((len(at), len(surfaces)), np.inf), np.full(len(at), np.inf)
    turned = comes_in.copy()
    for body, surface in enumerate(surfaces):
        t, normal = surface.boundary.entries(origin, direction, limit)
        rows = np.flatnonzero(np.isfinite(t))
        comes_in[rows, body] = t[rows]
        first[rows] = np.minimum(first[rows], surface.beside(t[rows], direction[rows], normal[rows]))
        numbers = wavefront.uniforms(paths.states, 1, at[rows])
        is_turned = rows[numbers[:, 0] < surface.chance(origin[rows] + t[rows, None] * direction[rows])]
        turned[is_turned, body] = t[is_turned]
    return comes_in, turned, first


def lets_in(surfaces, origin, direction, distance):
    """Share (n,) of light on ways of a distance (n,) m through the open that surfaces let into bodies, and where first grains can
    be ahead (n,) m, inf where none are."""
    share, first = np.ones(len(origin)), np.full(len(origin), np.inf)
    for surface in surfaces:
        t, normal = surface.boundary.entries(origin, direction, distance)
        rows = np.flatnonzero(np.isfinite(t))
        share[rows] *= 1 - surface.chance(origin[rows] + t[rows, None] * direction[rows])
        first[rows] = np.minimum(first[rows], surface.beside(t[rows], direction[rows], normal[rows]))
    return share, first
