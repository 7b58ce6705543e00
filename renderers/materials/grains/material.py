"""What an asset and a scene say of the grains, laid out for the loops."""

import math

import numpy as np

from bakery import kernels
from renderers.materials.grains._grains import Grains
from renderers.materials.grains._medium import Medium
from renderers.materials.grains.local import UNIFORM
from renderers.materials.grains.paths import SELDOM
from renderers.scene import meshes
from renderers.transport import solids

_FIGURES = ("hit_probability", "lambda_delta", "albedo", "lambda_s", "mean_square", "g", "forward_delta", "phase")
_PEAK = np.radians(5.0)  # light that a grain turns by less may count as not turned: it meets ten more
_NONE = 1e-12  # share of light below which it is rounding
SEED = 0  # of the hash that places grains: the same in all pictures of a scene


def meshes_of(scene):
    """Vertices (V, 3) m and triangles (F, 3) of the mesh of each of the scene's bodies.

    Raises UsageError, with the key, where one is no closed mesh, what is wrong, and where; or where two of them overlap.
    """
    return [meshes.of_entry(scene, number) for number in range(len(scene.values.materials))]


def refuse_overlap(scene, numbers, grains, meshes):
    """UsageError, with the key, where grains of one entry reach into the mesh of another's by more than a radius.

    numbers, grains, meshes : of the entries
    """
    for outer, body in zip(numbers, grains):
        for inner, (vertices, _) in zip(numbers, meshes):
            if inner != outer:
                corners = np.array(vertices / body.unit, order="C")
                deep = body.unit * kernels.deepest_in_mesh(body.aggregate, corners, kernels.aggregate_scratch())
                if deep > radius_of(body):
                    raise scene.wrong(f"materials[{inner}].where.mesh", f"reaches {deep:.2g} m into the mesh of "
                                      f"materials[{outer}]; meshes that do not overlap, but may touch, would do")


def radius_of(grains) -> float:
    """Of a body's largest sphere, m."""
    return grains.unit * float(grains.aggregate.radii.max())


def largest_of(asset) -> float:
    """Radius of the largest sphere of an asset's tile, m."""
    tile = _tile(asset)
    return _unit(asset, tile) * float(np.max(tile.radii))


def pixels_wide(view, triangles, radius) -> float:
    """Diameter of grains of a radius, m, at the nearest point of a mesh, triangles (F, 3, 3) m, in pixels of a view's camera."""
    return 2 * radius / (view.camera.pixel * max(distance(view.camera.origin, triangles), radius))


def distance(point, triangles) -> float:
    """From a point (3,) to the nearest of triangles (F, 3, 3): to one of their edges, or to a plane where its foot is inside."""
    corner = triangles - point
    edge = np.roll(corner, -1, axis=1) - corner
    along = -np.einsum("fki,fki->fk", corner, edge) / np.maximum(np.einsum("fki,fki->fk", edge, edge), 1e-300)
    nearest = np.linalg.norm(corner + np.clip(along, 0.0, 1.0)[..., None] * edge, axis=2).min()
    normal = np.cross(edge[:, 0], edge[:, 1])
    # inside: on the same side of all three edges; the point itself is the origin, and its foot differs from it along the normal
    inside = (np.einsum("fki,fi->fk", np.cross(corner, edge), normal) >= 0.0).all(axis=1)
    across = np.abs(np.einsum("fi,fi->f", corner[:, 0], normal)) / np.maximum(np.linalg.norm(normal, axis=1), 1e-300)
    return float(min(nearest, across[inside & (normal != 0.0).any(axis=1)].min(initial=np.inf)))


def number_in(packed, vertices, faces) -> float:
    """Grains that are expected in a mesh, vertices (V, 3) m."""
    aggregate = packed.aggregate
    volume = solids.volume(vertices / packed.unit, faces) * kernels.mean_share(aggregate)
    return volume * len(aggregate.radii) / float(np.prod(aggregate.cell))


def of_number(number: float) -> list[str]:
    """A sentence on a mesh that is too small for grains."""
    return [f"the mesh has room for {number:.1g} grains, and hardly one is seen: where.unit, or the grains' radius, may be meant "
            "otherwise"] if number < 1 else []


def meetings(asset, vertices, faces) -> float:
    """Grains of an asset in a mesh, vertices (V, 3) m, that light meets on average, at the wavelength where these are most.

    Without absorption paths through an evenly lit body are 4 V/S long in the mean, however light turns (Blanco & Fournier,
    Europhys. Lett. 61, 168, 2003).  What a half-space sends back has been scattered d ln R / d ln albedo times, of little
    absorption 2/sqrt(3 (1 - albedo)(1 - g)), as R = 1 - 4 s/sqrt 3, s^2 = (1 - albedo)/(1 - g) (van de Hulst 1980).  Inverse
    numbers are added, which is right in both limits.
    """
    medium = asset.medium
    sigma_t, albedo, g = (np.asarray(medium[name], float) for name in ("sigma_t", "albedo", "g"))
    return float(np.max(1 / (1 / (sigma_t * solids.chord(vertices, faces)) + np.sqrt(0.75 * (1 - albedo) * (1 - g)))))


def _tile(asset):
    """Of the asset's spheres, `bakery.physics.packing.tiles.Tile`."""
    return kernels.tile_of(asset.packing, asset.medium)


def _unit(asset, tile) -> float:
    """Mean radius of an asset's grains, m, which lengths of its tile are in: by the mean chord between the spheres.

    Radii in `grains` stand for a law by its cross section: their mean is 1.01 (log-normal, sigma 1.3) to 1.16 (2) of the law's.
    """
    return _void(asset) / (4 / 3 * float(np.sum(tile.radii**3) / np.sum(tile.radii**2)))


def medium_of(asset, grains):
    """The asset's effective medium in the mesh of its grains, without the forward peak of its phase functions: `_medium.Medium`,
    and `bakery.kernels.Varied` of it and of the light that its grains meet, which passes where it is in the peak.

    Panes such as two faces of a cube let light go on as it came.  Samples of lights would hardly ever find it.
    """
    theta = np.asarray(asset.medium.theta, float)
    parts = _components(asset) if grains.mixture.values.size > 0 else [_whole(asset)]
    cut = [without_peak(np.ones(len(part.albedo)), part.albedo, theta, part.phase) for part in parts]
    turned, albedo, phase = (list(figures) for figures in zip(*cut))
    turned = np.array(turned)
    sigma_t, varied, met_by = _extinction(asset, grains, parts, turned)
    layouts = [kernels.phase_layout(theta, row) for rows in phase for row in rows]
    return Medium(grains.aggregate, grains.unit, sigma_t, np.concatenate(albedo), layouts[0][0], layouts[0][1],
                  np.array([row[2] for row in layouts]), np.array([row[3] for row in layouts]),
                  seldom(grains.aggregate, sigma_t.min()), turned=np.concatenate(turned)), varied, met_by


def _extinction(asset, grains, parts, turned):
    """sigma_t (L,) 1/unit, the most where it varies, how it does, and how all light does that meets grains.

    parts : `bakery.kernels.Component` of each of C components;  turned : (C, L) of their extinction, without the peak
    """
    same = kernels.unvaried_medium()
    unit, share = grains.unit, grains.aggregate.share
    baked, alone = unit * np.array(asset.medium.sigma_t, float), grains.mixture.values.size == 0
    if alone and share.values.size == 0:
        return baked * turned[0], same, same
    fraction, void = fraction_of(asset), _void(asset) / unit
    hits = np.array([np.full(len(baked), part.hit_probability) for part in parts])
    along = np.array([part.along for part in parts]) / unit
    weights = (1.0,) if alone else np.diff(grains.shares, prepend=0.0)
    excess = baked / kernels.extinction_at_fraction(void, fraction, hits, along, weights) - 1
    if alone and share.values.min() == share.values.max():
        every = float(share.values.flat[0])
        thin = kernels.extinction_at_fraction(void, fraction * every, hits, along) * (1 + every * excess)
        return thin * turned[0], same, same
    varied = kernels.varied_medium(share, grains.mixture, fraction, void, hits * turned, along, excess)
    return np.full(len(baked), varied.most), varied, varied._replace(hits=hits)


def _whole(asset):
    """All grains of an asset as one `bakery.kernels.Component`; lengths in m."""
    group = asset.medium
    return kernels.whole_medium(float(group.hit_probability[0]), np.asarray(group.sigma_t_mean_flight, float),
                                float(group.void_chord[0]), np.array(group.albedo, float), np.asarray(group.phase, float))


def _components(asset):
    """Each component of an asset's grains as a `bakery.kernels.Component`; lengths in m."""
    group, components = asset.grains, []
    radii, shares = np.asarray(group.radius, float), np.asarray(group.radius_share, float)
    for name in group.exemplars:
        part = group[name]
        places = {figure: part.by_radius if "by_radius" in part and figure in part.by_radius else part for figure in _FIGURES}
        figures = {figure: np.asarray(source[figure], float) for figure, source in places.items()}
        figures = {figure: value if places[figure] is not part else np.repeat(value[None], len(radii), axis=0)
                   for figure, value in figures.items()}
        components.append(kernels.medium_component(np.asarray(group.theta, float), figures, radii, shares))
    return components


def _void(asset):
    """Mean chord between the asset's spheres over (1 - f)/f, m."""
    fraction = float(asset.medium.fraction[0])
    return float(asset.medium.void_chord[0]) * fraction / (1 - fraction)


def fraction_of(asset) -> float:
    """Share of the volume in the spheres of the tile that a body is filled with."""
    tile = _tile(asset)
    return float(4 / 3 * np.pi * np.sum(tile.radii**3) / np.prod(tile.cell))


def without_peak(sigma_t, albedo, theta, phase):
    """The same (L,), (L,), (L, A) where what phase functions have above their value at `_PEAK`, within it, is not scattered."""
    cut = np.where(theta < _PEAK, np.minimum(phase, kernels.phase_at(theta, phase, np.array([_PEAK]))), phase)
    kept = kernels.phase_integral(theta, cut)
    scattered, extinction = albedo * kept, 1 - albedo * (1 - kept)
    # grains of the host's index turn nothing: what does not scatter has any phase function, what takes nothing any albedo
    straight, taken = kept <= _NONE, extinction > _NONE
    cut[straight], kept[straight] = 1.0, 4 * np.pi
    albedo = np.divide(scattered, extinction, out=np.zeros_like(scattered), where=taken)
    return sigma_t * np.where(taken, extinction, 0.0), albedo, cut / kept[:, None]


def seldom(aggregate, sigma_t):
    """Chance (X, Y, Z) of a light sample in each voxel, less far inside, where hardly any light gets to; sigma_t in 1/unit."""
    return np.maximum(np.exp(-sigma_t * kernels.depth_in_mesh(aggregate)), SELDOM).astype(np.float32)


def grains_of(asset, vertices, faces, local=UNIFORM) -> Grains:
    """The asset's grains in a mesh, vertices (V, 3) m; local : of `local.local_of`, what varies in it."""
    group, middle = asset.grains, len(asset.wavelength) // 2
    tile = _tile(asset)
    unit = _unit(asset, tile)
    types = [_Grain(exemplar, middle) for exemplar in group.exemplars.values()]
    parts = [group[name] for name in group.exemplars]
    share, mixture = (field and field._replace(low=field.low / unit, edge=field.edge / unit) for field in local)
    aggregate = kernels.aggregate(*tile[:3], vertices / unit, faces, share, SEED)
    sigma_t = unit * float(np.min(asset.medium.sigma_t)) * (float(share.values.max()) if share else 1.0)
    return Grains(aggregate, unit, np.uint64(SEED),
                  kernels.cumulated_shares([float(part.weight[0]) for part in parts]), kernels.exemplars(types),
                  np.array([_channels(exemplar.surface, len(asset.wavelength)) for exemplar in group.exemplars.values()]),
                  np.array([unit * np.asarray(part.interior, float) for part in parts]),
                  seldom(aggregate, sigma_t), mixture or kernels.uniform_field())


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
    matter = kernels.diffuse(surface["reflectance"]) if surface["type"] == "diffuse" else kernels.conductor(_complex(surface))
    return np.array(np.broadcast_to(matter.channels, (2, waves)))


def occupied_by(world, aggregate, unit, others=()):
    """Voxels (X, Y, Z) uint8 of an aggregate that surfaces of the scene pass through, or that spheres of other bodies reach.

    Empty where there are none.

    others : of the bodies, triples of vertices (V, 3) m, triangles (F, 3), radius of the largest sphere, m
    """
    voxels = np.zeros(aggregate.voxels.shape, np.uint8)
    low, size = aggregate.low, aggregate.edge * voxels.shape
    triangles, boxes = (extent / unit for extent in world.extents(within=unit * np.array([low, low + size])))
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


def reasons_of(asset, angle=0.0) -> list[str]:
    """Sentences about what paths among its grains leave out; angle : `renderers.materials.grains.transport.Transport.angle`."""
    surfaces = [exemplar.surface for exemplar in asset.grains.exemplars.values()]
    sentences = []
    if any(surface["type"] == "dielectric" and len(set(surface["index"])) > 1 for surface in surfaces):
        sentences.append("grains refract all wavelengths as the middle one")
    smooth = any(surface["type"] != "diffuse" and surface["roughness"] == 0 for surface in surfaces)
    if smooth and angle > 0:
        sentences.append(f"smooth grains show small lamps as discs of {math.degrees(angle):.2g} degrees around them, which "
                         "shrink with samples (widen: 0 deg shows them as they are)")
    elif smooth:
        sentences.append("light reaches smooth grains by chance: lights without extent do not show in them, and small ones "
                         "in rare bright pixels, or, after few samples, in none (method: ept+wide shows them as discs)")
    return sentences


def opaque(asset) -> bool:
    """Whether light does not go into some of its grains."""
    return any(exemplar.surface["type"] != "dielectric" for exemplar in asset.grains.exemplars.values())


def reasons_of_medium(asset) -> list[str]:
    """Sentences about what the medium that stands for its grains leaves out."""
    sentences = ["the medium that stands for the grains: no grain is to be seen"]
    if opaque(asset):
        sentences.append("packed opaque grains reflect more than a medium, dark ones twice as much (docs/granular.md)")
    return sentences
