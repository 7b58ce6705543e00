"""Materials of a scene, each as paths meet it, and their places."""

from typing import NamedTuple

import numpy as np

from bakery import kernels
from renderers.materials.bodies import bodies, shells
from renderers.materials.bodies.interactor import Body
from renderers.materials.grains import material as packed
from renderers.materials.grains.interactor import Grains
from renderers.materials.medium.interactor import Medium
from renderers.materials.particles.interactor import Particles
from renderers.mixed import contents
from renderers.transport import places, regions
from renderers.transport.places import BLIND, TURNS, Places, Region
from renderers.transport.waves import Scene


class Material(NamedTuple):
    """What fills a region.

    region : `renderers.transport.places.Region`
    content : `renderers.transport.scattering.Scatterer` of a continuous medium or a body,
        `renderers.materials.particles.medium.Medium` of particles, `renderers.materials.grains._grains.Grains`
    kind : medium, particles or grains
    density : `bakery.kernels.Region` of relative densities, 0 to 1, of a medium that varies; None: it does not
    body : of a shape of the scene that a medium fills, its `renderers.mitsuba.shapes.Shape`, with vertices and faces of a solid
    """

    region: Region
    content: object
    kind: str = "medium"
    density: kernels.Region | None = None
    body: object = None


def material_of(content) -> Material:
    """Of what an entry is (`renderers.mixed.contents`)."""
    if isinstance(content, contents.Particles):
        return Material(Region(content.region, content.volume), content.medium, "particles")
    if isinstance(content, contents.Grains):
        return Material(places.mesh(*content.region, solid=True), content.grains, "grains")
    if isinstance(content, contents.Body):
        region = places.mesh(content.vertices, content.faces, BLIND if content.matched else TURNS)
        return Material(region, content.medium, body=content.shape)
    if isinstance(content.region, regions.Everywhere):
        return Material(places.EVERYWHERE, content.scatterer)
    if isinstance(content.region, regions.Mesh):
        return Material(places.mesh(*content.region), content.scatterer)
    density = kernels.region_grid(*content.region) if isinstance(content.region, regions.Grid) else None
    return Material(places.box(content.region.lo, content.region.hi), content.scatterer, density=density)


def scene_of(world, materials, colours, angle=0.0) -> Scene:
    """What paths go through.

    materials : list of `Material`, whose positions are their numbers;  angle : as a `Scene` has it
    """
    where = Places([material.region for material in materials])
    walked, geometry = _walked(world, materials, where)
    interactors = []
    for number, material in enumerate(materials):
        if material.kind == "particles":
            interactors.append(Particles(material.content, _holder(where, number) if where.within(number) else None))
        elif material.kind == "grains":
            interactors.append(Grains(number, material.content, _occupied(world, material.content, where, number), colours))
        elif number in walked:
            blind = [materials[neighbour].region.bounds == BLIND for neighbour in walked]
            interactors.append(Body(material.content, colours, geometry, blind, _sampled(world, material)))
        else:
            extent = _extent(world, where) if material.region.layout is None else None
            interactors.append(Medium(material.content, colours, material.density, _sampled(world, material), extent))
    return Scene(world, tuple(interactors), where, colours, any(material.region.bounds == BLIND for material in materials), angle)


def _extent(world, where):
    """Middle (3,) and radius, m, of a ball around all surfaces, regions and the camera, and lamps without extent, in whose glow
    paths do not end."""
    corners = [region.box for region in where.regions if region.layout is not None]
    corners += [] if world.box is None else [world.box]
    corners += [light.place[None] for light in world.ideal_lights() if not light.distant]
    corners = np.concatenate([*corners, world.camera.origin[None]])
    low, high = corners.min(axis=0), corners.max(axis=0)
    return (low + high) / 2, max(float(np.linalg.norm(high - low)) / 2, 1e-30)


def _sampled(world, material):
    """Whether light samples reach events: through a boundary that turns light none does."""
    return material.region.bounds != TURNS or bool(world.lights_in([material.region.box]))


def _holder(where, number):
    return lambda points, directions: where.find(points, directions)[0] == number


class _Crowded(Exception):
    """A surface that is no mesh reaches into a body."""


def _walked(world, materials, where):
    """Numbers of bodies in which there are no other materials than such bodies, and the triangles in them."""
    walked, geometry = [number for number, material in enumerate(materials) if material.body is not None], None
    while walked and geometry is None:
        alone = [number for number in walked if set(where.within(number)) <= set(walked)]
        if alone == walked:
            try:
                geometry = bodies.laid_out(world, [_laid(materials[number]) for number in walked],
                                           lambda body, key, message: _Crowded(body))[1]
            except _Crowded as fault:
                alone = [number for position, number in enumerate(walked) if position != fault.args[0]]
        walked = alone
    return walked, geometry


def _laid(material):
    """As the layout of triangles takes it."""
    shape = material.body
    return bodies.Body(shape.name, shape.vertices, shape.faces, shape.index, shape.smooth, material.content, [], False,
                       shells.none(len(material.content.sigma_t)))


def _occupied(world, grains, where, number):
    """Voxels (X, Y, Z) uint8 of grains on the way through which paths look around: there are surfaces or other materials."""
    aggregate = grains.aggregate
    occupied = packed.occupied_by(world, aggregate, grains.unit)
    others = where.within(number)
    if not others and not where.around_of(number):
        return occupied
    if occupied.size == 0:
        occupied = np.zeros(aggregate.voxels.shape, np.uint8)
    if where.around_of(number):
        occupied[kernels.depth_in_mesh(aggregate) <= 0] = 1
    for inner in others:
        low, high = (where.regions[inner].box / grains.unit - aggregate.low) / aggregate.edge
        first, last = np.maximum(np.floor(low).astype(int), 0), np.floor(high).astype(int) + 1
        occupied[tuple(slice(a, max(b, 0)) for a, b in zip(first, last))] = 1
    return occupied
