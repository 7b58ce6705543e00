"""What the entries of a scene are: where, and what fills them."""

from typing import NamedTuple

import numpy as np

from bakery import kernels
from renderers.materials.bodies.bodies import solid_shape
from renderers.materials.grains import local, material
from renderers.materials.grains.declared.ept import smooth
from renderers.materials.grains.methods import cone
from renderers.materials.particles import continuum, place
from renderers.materials.particles.medium import classes_of, medium, without_peak
from renderers.materials.particles.methods import peak_angle, peak_sentence
from renderers.mixed.scene import chosen
from renderers.scene import grids, meshes
from renderers.scene.entries import declared
from renderers.transport import regions
from renderers.transport.scattering import Scatterer

_WITHOUT_SKY = ("light at infinity (sky, sun) does not get into a medium that is everywhere, as it has no end; "
                "where: {box: …} around the scene lets it in")


class Body(NamedTuple):
    """A shape of the scene that a medium fills, as `renderers.transport.passes.part` takes it.

    vertices, faces : (V, 3) m, (F, 3), closed, outward;  shape : of the world, with those
    """

    name: str
    vertices: np.ndarray
    faces: np.ndarray
    medium: Scatterer
    matched: bool
    shape: object


class Particles(NamedTuple):
    """region : `bakery.kernels.Region`;  medium : `renderers.materials.particles.medium.Medium`;  volume : of the region, m^3"""

    region: kernels.Region
    medium: object
    volume: float


class Grains(NamedTuple):
    """region : `regions.Mesh`;  grains : `renderers.materials.grains._grains.Grains`

    angle : rad, of `renderers.transport.regularised`, of smooth grains that show small lamps wider; 0 of others
    """

    region: regions.Mesh
    grains: object
    angle: float = 0.0


class Content(NamedTuple):
    """Of an entry.

    what : `Particles`, `Grains`, `Body`, or of a medium without a boundary `regions.Medium`
    stands : `Body` or `regions.Medium`, by which a filter of noise knows the colour of what is seen
    reasons : sentences about what is approximate
    """

    what: object
    stands: object
    reasons: tuple[str, ...] = ()


def of(scene, world, asset, spectra, number) -> Content:
    """Of an entry of a scene, by its number.

    spectra : `renderers.mixed.spectra.Spectra`

    Raises UsageError, with the key, where the entry's shape, mesh, grid or box is not what it should be.
    """
    entry = scene.values.materials[number]
    method = declared(entry.kind)[chosen(entry.kind, entry.method)]
    if entry.kind == "particles":
        return _particles(scene, world, asset, spectra, number, method)
    if entry.kind == "grains":
        return _grains(scene, world, asset, spectra, number)
    whole = spectra.medium(asset, *(np.asarray(asset.medium[name], float) for name in ("sigma_t", "albedo", "phase")))
    if hasattr(entry.where, "shape"):
        shape = solid_shape(world.shapes(), entry.where.shape, entry.index,
                            lambda key, message: scene.wrong(f"materials[{number}].{key}", message))
        body = Body(shape.name, shape.vertices, shape.faces, whole, shape.index == 1.0, shape)
        return Content(body, body)
    medium = regions.Medium(_region(scene, number), whole, f"materials[{number}]")
    endless = isinstance(medium.region, regions.Everywhere) and np.max(whole.sigma_t) > 0
    return Content(medium, medium, (f"materials[{number}]: {_WITHOUT_SKY}",) if endless and world.sky else ())


# ---- each kind


def _particles(scene, world, asset, spectra, number, method):
    entry, group = scene.values.materials[number], asset.discrete
    angle = peak_angle(entry, world)
    classes = without_peak(spectra.classes(asset, classes_of(group)), angle)
    region = place.region_of(scene, group, number)
    place.check_motion(scene, group, region, number)
    discs = place.discs_of(group, region, entry.velocity, entry.time)
    tabulated, _ = medium(classes, discs, spectra.colours.to_rgb, spectra.colours.to_waves)
    reasons = (f"materials[{number}]: {peak_sentence(classes, angle)}",)
    stands = regions.Medium(continuum.region_of(scene, number, region, group), continuum.scatterer_of(tabulated),
                            f"materials[{number}]")
    if not method.continuous:
        return Content(Particles(region, tabulated, regions.volume(stands.region)), stands, reasons)
    if np.any(tabulated.host) and region.kind != kernels.BOX:
        raise scene.wrong(f"materials[{number}].method", f"found {method.name}, but the host of the particles absorbs light "
                          f"in the whole box, also beside the mesh or the grid; expected method {chosen(entry.kind, 'auto')}")
    return Content(stands, stands, (*reasons, f"materials[{number}]: no particle is told apart"))


def _grains(scene, world, asset, spectra, number):
    entry = scene.values.materials[number]
    method = declared(entry.kind)[chosen(entry.kind, entry.method)]
    vertices, faces = meshes.of_entry(scene, number)
    region = regions.Mesh(vertices, faces)
    values = (np.asarray(asset.medium[name], float) for name in ("sigma_t", "albedo", "theta", "phase"))
    sigma_t, albedo, phase = material.without_peak(*values)
    stands = regions.Medium(region, spectra.medium(asset, sigma_t, albedo, phase), f"materials[{number}]")
    if method.continuous:
        return Content(stands, stands, tuple(f"materials[{number}]: {reason}" for reason in material.reasons_of_medium(asset)))
    varies = local.local_of(scene, number, asset, material.fraction_of(asset), vertices)
    grains = spectra.grains(asset, material.grains_of(asset, vertices, faces, varies))
    angle = cone(method, entry.widen, world, [asset], [(vertices, faces)])
    explicit = Grains(region, grains, angle)
    return Content(explicit, stands, _reasons(number, asset, explicit))


def _reasons(number, asset, packed):
    """Sentences on `Grains` of an entry."""
    reasons = material.of_number(material.number_in(packed.grains, *packed.region)) + material.reasons_of(asset, packed.angle)
    return tuple(f"materials[{number}]: {reason}" for reason in reasons)


def shown_alike(filled, assets) -> list[Content]:
    """Contents of all entries whose smooth grains show small lamps as the narrowest discs of any: what a path brings is not told
    by the grain that turned it."""
    angle = min((content.what.angle for content in filled if isinstance(content.what, Grains) and content.what.angle > 0),
                default=0.0)

    def alike(number, content, asset):
        packed = content.what._replace(angle=angle)
        return content._replace(what=packed, reasons=_reasons(number, asset, packed))

    return [alike(number, content, asset) if angle and isinstance(content.what, Grains) and smooth([asset]) else content
            for number, (content, asset) in enumerate(zip(filled, assets, strict=True))]


def _region(scene, number):
    """Of a medium that no shape of the scene bounds."""
    where = scene.values.materials[number].where
    if hasattr(where, "everywhere"):
        return regions.Everywhere()
    if hasattr(where, "box"):
        return regions.Box(np.array(where.box.lo), np.array(where.box.hi))
    if hasattr(where, "mesh"):
        return regions.Mesh(*meshes.of_entry(scene, number))
    key = f"materials[{number}].where"
    values, lo, hi = grids.relative(scene, key, where, float)
    return regions.Grid(lo, hi, values)
