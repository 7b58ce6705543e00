"""What an asset and a scene say of the grains, laid out for the loops."""

from __future__ import annotations

import numpy as np

from bakery import kernels
from renderers import colour
from renderers.granular._grains import Grains
from renderers.granular._medium import Medium
from renderers.granular.paths import SELDOM, Colours

_PEAK = np.radians(5.0)  # light that a grain turns by less may count as not turned: it meets ten more
SEED = 0  # of the hash that places grains: the same in all pictures of a scene


def meshes_of(scene):
    """Vertices (V, 3) m and triangles (F, 3) of the mesh of each of the scene's bodies.

    Raises UsageError, with the key, where one is no closed mesh, what is wrong, and where; or where two of them overlap.
    """
    meshes = []
    for number, body in enumerate(scene.values.granular.bodies):
        path = scene.file(body.mesh)
        try:
            vertices, faces = kernels.closed_mesh(path.read_bytes(), path.suffix.lstrip(".").lower())
        except ValueError as fault:
            raise scene.wrong(f"{scene.values.granular.key(number)}.mesh", fault) from None
        meshes.append((body.unit * vertices, faces))
    return meshes


def overlap(grains, meshes):
    """Two bodies, the second with a corner of its mesh in the first, and how deep, m: more than a radius.  None if none."""
    for outer, body in enumerate(grains):
        for inner, (vertices, _) in enumerate(meshes):
            if inner != outer:
                corners = np.array(vertices / body.unit, order="C")
                deep = body.unit * kernels.deepest_in_mesh(body.aggregate, corners, kernels.aggregate_scratch())
                if deep > radius_of(body):
                    return outer, inner, deep
    return None


def radius_of(grains) -> float:
    """Of a body's largest sphere, m."""
    return grains.unit * float(grains.aggregate.radii.max())


def colours_of(asset) -> Colours:
    """From and to the asset's wavelengths."""
    waves = np.asarray(asset.wavelength, float)
    return Colours(np.ascontiguousarray(colour.srgb_matrix(waves)), np.ascontiguousarray(colour.spread_matrix(waves)))


def medium_of(asset, aggregate, unit) -> Medium:
    """The asset's effective medium in the mesh of an aggregate, without the forward peak of its phase functions.

    Panes such as two faces of a cube let light go on as it came.  Samples of lights would hardly ever find it.
    """
    group = asset.medium
    theta, phase = np.asarray(group.theta, float), np.asarray(group.phase, float)
    sigma_t, albedo, phase = without_peak(unit * np.array(group.sigma_t, float), np.array(group.albedo, float), theta, phase)
    layouts = [kernels.phase_layout(theta, row) for row in phase]
    return Medium(aggregate, unit, sigma_t, albedo, layouts[0][0], layouts[0][1], np.array([one[2] for one in layouts]),
                  np.array([one[3] for one in layouts]), seldom(aggregate, sigma_t.min()))


def without_peak(sigma_t, albedo, theta, phase):
    """The same (L,), (L,), (L, A) where what phase functions have above their value at `_PEAK`, within it, is not scattered."""
    cut = np.where(theta < _PEAK, np.minimum(phase, kernels.phase_at(theta, phase, np.array([_PEAK]))), phase)
    left = kernels.phase_integral(theta, cut)
    scattered, extinction = albedo * left, 1 - albedo * (1 - left)
    return sigma_t * extinction, scattered / extinction, cut / left[:, None]


def seldom(aggregate, sigma_t):
    """Chance (X, Y, Z) of a light sample in each voxel, less far inside, where hardly any light gets to; sigma_t in 1/unit."""
    return np.maximum(np.exp(-sigma_t * kernels.depth_in_mesh(aggregate)), SELDOM).astype(np.float32)


def grains_of(asset, vertices, faces) -> Grains:
    """The asset's grains in a mesh, vertices (V, 3) m."""
    group, middle = asset.grains, len(asset.wavelength) // 2
    unit = float(np.sum(np.asarray(group.radius) * np.asarray(group.radius_share)))
    types = [_Grain(one, middle) for one in group.exemplars.values()]
    parts = [group[name] for name in group.exemplars]
    aggregate = kernels.aggregate(*_tile(asset), vertices / unit, faces)
    return Grains(aggregate, unit, np.uint64(SEED),
                  kernels.cumulated_shares([float(part.weight[0]) for part in parts]), kernels.exemplars(types),
                  np.array([_channels(one.surface, len(asset.wavelength)) for one in group.exemplars.values()]),
                  np.array([unit * np.asarray(part.interior, float) for part in parts]),
                  seldom(aggregate, unit * float(np.min(asset.medium.sigma_t))))


class _Grain:
    """What `bakery.kernels.exemplars` takes of an exemplar; its index is that at one wavelength."""

    def __init__(self, exemplar, wavelength):
        surface = exemplar.surface
        if surface["type"] == "dielectric":
            self.surface = kernels.dielectric(surface["index"][wavelength], surface["roughness"])
        elif surface["type"] == "diffuse":
            self.surface = kernels.diffuse(surface["reflectance"])
        else:
            self.surface = kernels.conductor(_complex(surface), surface["roughness"])
        self.mesh = None if exemplar.ball else kernels.Mesh(exemplar.vertices, exemplar.faces)
        self.radius = 1.0


def _complex(surface):
    return np.array(surface["n"], float) + 1j * np.array(surface["k"], float)


def _channels(surface, waves):
    """(2, L), as `bakery.kernels.surface_share` takes them."""
    if surface["type"] == "dielectric":
        return np.zeros((2, waves))
    made = kernels.diffuse(surface["reflectance"]) if surface["type"] == "diffuse" else kernels.conductor(_complex(surface))
    return np.array(np.broadcast_to(made.channels, (2, waves)))


def _tile(asset):
    """Centres, radii and cell: the least dense tile that is as dense as the medium, widened until it is just that."""
    packing, wished = asset.packing, float(asset.medium.fraction[0])
    tiles = [packing] if "centers" in packing else [one for one in packing.values() if "centers" in one]
    dense = [one for one in tiles if float(one.fraction[0]) >= wished * (1 - 1e-9)]
    tile = min(dense, key=lambda one: float(one.fraction[0])) if dense else max(tiles, key=lambda one: float(one.fraction[0]))
    wider = max(float(tile.fraction[0]) / wished, 1.0) ** (1 / 3)
    return np.asarray(tile.centers) * wider, np.asarray(tile.radii), np.asarray(tile.cell) * wider


def occupied_by(world, aggregate, unit, others=()):
    """Voxels (X, Y, Z) uint8 of an aggregate that surfaces of the scene pass through, or that spheres of other bodies reach.

    Empty where there are none.

    others : of the bodies, triples of vertices (V, 3) m, triangles (F, 3), radius of the largest sphere, m
    """
    voxels = np.zeros(aggregate.voxels.shape, np.uint8)
    triangles, boxes = (one / unit for one in world.extents())
    faces = np.arange(3 * len(triangles)).reshape(-1, 3)
    meshes = [(triangles.reshape(-1, 3), faces, 1e-6 * float(aggregate.edge.max()))]
    meshes += [(vertices / unit, faces, radius / unit) for vertices, faces, radius in others]
    for vertices, faces, reach in meshes:
        kernels.mark_voxels(voxels, aggregate.low, aggregate.edge, np.array(vertices, order="C"), np.array(faces, np.int64),
                            reach, np.uint8(1))
    for low, high in boxes:
        first, last = ((np.floor((corner - aggregate.low) / aggregate.edge + shift)).astype(int)
                       for corner, shift in ((low, -1e-6), (high, 1e-6)))
        if np.all(last >= 0):
            voxels[tuple(slice(max(a, 0), b + 1) for a, b in zip(first, last))] = 1
    return voxels if voxels.any() else np.zeros((0, 0, 0), np.uint8)
