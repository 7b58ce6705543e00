"""The methods of a scene: which passes make its picture, and what is to be said of them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from bakery.kernels import BOX
from renderers import budget, colour
from renderers.discrete import continuum, detail, explicit, place, query, splat, walk
from renderers.discrete.medium import Classes, Medium, classes_of, in_bands, medium, without_peak
from renderers.engine import Part
from renderers.passes import Method

_LAYERS = ("order0", "order1", "order2", "orders")
_HALF = 0.5
_INSIDE = 0.01  # of the box's diagonal: how far from the camera a medium begins that it stands in


class Setup(NamedTuple):
    """What the methods work with: the asset's classes, as baked and with the forward peak taken out, and where they are."""

    settings: object
    group: object
    world: object
    region: object
    waves: np.ndarray
    bands: np.ndarray
    baked: Classes
    classes: Classes
    discs: object
    medium: Medium
    order: np.ndarray
    scene: object


def prepare(job, world, seed, tolerance=None) -> Method:
    """The method that a scene asks for.

    Parameters
    ----------
    job : `renderers.running.Render`
    world : `renderers.mitsuba.world.World`
    seed : of the passes
    tolerance : relative deviation of a pixel that taking the continuous medium for particles may make; the scene's if None
    """
    tolerance = budget.of(job.scene).approximations if tolerance is None else tolerance
    name, (height, width) = job.scene.values.method, world.size
    angle = peak_angle(job.scene.values.materials[0], world)
    setup = _setup(job, world, angle)
    passes, depth, reasons = _METHODS[name](setup, tolerance, seed)
    lights = world.light_names
    everywhere = np.full((height, width), np.inf) if depth is None else depth
    parts = tuple(each if isinstance(each, Part) else
                  Part(each[0], _pass(*each[1:], world, height, width, seed, everywhere, lights)) for each in passes)
    more = _figures(setup, depth) | {"layers": _layers(depth)}
    return Method(name, parts, [peak_sentence(setup.classes, angle), *reasons], lambda estimate: more,
                  features=None if name in _SINGLE else lambda: _features(setup, seed),
                  apart=("walk",) if name in _SINGLE else ("splat",))


def _features(setup, seed):
    """What the camera sees, with the particles as a medium: those that are seen as such are in no filter."""
    from renderers.scattering import scatterer
    from renderers.transport import features, regions

    region, medium = setup.region, setup.medium
    # where it scatters light to plays no role
    haze = scatterer(medium.sigma_t, medium.albedo[-1], np.array([0.0, math.pi]), np.ones((len(medium.sigma_t), 2)))
    where = regions.Box(region.lo, region.hi) if region.kind == BOX else regions.Grid(region.lo, region.hi, region.values)
    return features.first_hits(setup.world, [regions.Medium(where, haze)], medium, seed)


def peak_angle(settings, world):
    """Within which the forward peak counts as unscattered, rad; 0: nothing does."""
    if settings.method == "explicit" or settings.peak == "keep":
        return 0.0
    return _HALF * float(np.median(world.camera.angle(*world.size))) if settings.peak == "auto" else settings.peak


def _setup(job, world, angle) -> Setup:
    values, group = job.scene.values, job.asset.discrete
    settings, waves = values.materials[0], np.asarray(job.asset.wavelength, float)
    baked, bands = classes_of(group), np.eye(len(waves))
    to_rgb, to_waves = colour.srgb_matrix(waves), colour.spread_matrix(waves)
    if values.film.wavelengths == "rgb":
        bands, to_rgb, to_waves = colour.band_matrix(waves), np.eye(3), np.eye(3)
        baked = in_bands(baked, bands)
    region, classes = place.region_of(job.scene, group), without_peak(baked, angle)
    place.check_motion(job.scene, group, region)
    discs = place.discs_of(group, region, settings.velocity, settings.time)
    tabulated, order = medium(classes, discs, to_rgb, to_waves)
    return Setup(settings, group, world, region, waves, bands, baked, classes, discs, tabulated, order, job.scene)


# ---- each method: its passes (parts, or name, function, what it takes), depths of particles, reasons


def _continuous(setup, tolerance, seed):
    part = continuum.part(setup, seed) or ("walk", walk.one_pass, walk.Discs(setup.medium, later=0.0))
    return [part], np.zeros(setup.world.size), []


def _particles(setup, tolerance, seed):
    depth = np.full(setup.world.size, np.inf)
    return _walk_and_splat(setup, depth, later=np.inf, drawn=False), depth, []


def _auto(setup, tolerance, seed):
    depth = detail.depths(setup.world, setup.medium, setup.world.camera, *setup.world.size, tolerance, seed)
    # of a realisation that is known light meets the others: a particle is not in its own surroundings
    others = 1 - 1 / max(float(setup.group.number[0]), 1.0) if "position" in setup.group else 1.0
    setup = setup._replace(medium=setup.medium._replace(others=others))
    return _walk_and_splat(setup, depth, later=0.0, drawn=True), depth, [_detail(depth, tolerance)]


def _walk_and_splat(setup, depth, later, drawn):
    eye = setup.world.camera.origin if drawn else None
    passes = [("walk", walk.one_pass, walk.Discs(setup.medium, later=later, splatted=True, eye=eye))]
    if depth.max() > 0 and setup.world.light_names:
        how = splat.plan(setup.medium, setup.world.camera, *setup.world.size, depth, drawn)
        passes.append(("splat", splat.one_pass, (setup.medium, how)))
    return passes


def _query(setup, tolerance, seed):
    """Cylinders whose cross section is a share of a pixel where the medium begins (Eq. 23)."""
    origin, region, order, footprint = setup.world.camera.origin, setup.region, setup.order, setup.settings.footprint
    nearest = float(np.linalg.norm(np.maximum(np.maximum(region.lo - origin, origin - region.hi), 0.0)))
    nearest = max(nearest, _INSIDE * float(np.linalg.norm(region.hi - region.lo)))
    pixel = math.sqrt(np.linalg.norm(np.cross(setup.world.camera.right, setup.world.camera.down)))
    radius = math.sqrt(footprint * pixel**2 / math.pi) * nearest
    classes = setup.classes
    reach = np.broadcast_to(math.pi * (classes.radius[order] + radius) ** 2, classes.extinction.shape)
    method = query.Query(setup.medium._replace(discs=setup.discs(reach, classes.density[order], order)),
                         np.ascontiguousarray(classes.extinction[:, order].T),
                         np.ascontiguousarray(classes.scattering[:, order].T), radius)
    return [("walk", walk.one_pass, method)], None, [
        f"queries of the paper, cylinders of {footprint:g} pixels: their mean is not the continuous medium's"]


def _explicit(setup, tolerance, seed):
    """Spheres of the classes' radii and their components' indices."""
    parts = [setup.group[name] for name in setup.group.classes().names]
    host, middle = np.asarray(setup.group.host, float), int(np.argsort(setup.waves)[len(setup.waves) // 2])
    index = np.array([part.n[middle] / host[middle] for part in parts], float)
    absorption = np.array([4 * math.pi * np.asarray(part.k, float) / (setup.waves * 1e-6) for part in parts]) @ setup.bands.T
    order = setup.order
    reach = np.broadcast_to(math.pi * setup.baked.radius[order] ** 2, setup.baked.extinction.shape)
    spheres = setup.medium._replace(discs=setup.discs(reach, setup.baked.density[order], order))
    of = setup.baked.component[order]
    method = explicit.Spheres(spheres, index[of], np.ascontiguousarray(absorption[of]))
    return [("walk", walk.one_pass, method)], None, [
        "spheres of geometrical optics: without diffraction, and with the index of the middle wavelength"]


_METHODS = {"auto": _auto, "particles": _particles, "continuous": _continuous, "query": _query, "explicit": _explicit}

_SINGLE = ("query", "explicit")  # methods that show particles in all of their light


def _pass(function, what, world, height, width, seed, depth, lights):
    """A pass as `Part` takes it: its number -> layers."""

    def one(number):
        by_order, by_light = function(world, what, world.camera, height, width, number, seed, discrete=depth, lights=len(lights))
        layers = {"": by_order.sum(axis=0)} | dict(zip(_LAYERS, by_order)) \
            | {f"light.{name}": image for name, image in zip(lights, by_light)}
        # walks have all layers; what splats leave black takes memory for nothing
        return {name: image for name, image in layers.items() if not name or function is walk.one_pass or image.any()}

    return one


def peak_sentence(classes, angle):
    if angle == 0:
        return "the forward peak of the phase functions is kept"
    share = 100 * classes.peak
    return (f"light scattered within {math.degrees(angle):.3g} degrees of forward counts as unscattered: {share.min():.3g} to "
            f"{share.max():.3g} % of the extinction; halos narrower than that are left out (peak: keep)")


def _detail(depth, tolerance):
    shown = float(np.mean(depth > 0))
    return (f"{100 * shown:.3g} % of the pixels show particles as particles; elsewhere, and beyond the depths of layer detail, "
            f"they deviate from the continuous medium by less than {100 * tolerance:.2g} %; scattering after the first is the "
            "continuous medium's")


def _layers(depth):
    """Layers `detail` and `method` of the picture."""
    if depth is None:
        return {}
    return {"detail": np.minimum(depth, 1e30), "method": np.where(depth == 0, 0.0, np.where(np.isinf(depth), 1.0, 2.0))}


def _figures(setup, depth):
    region, group = setup.region, setup.group
    tau = setup.classes.sigma_t * float((region.hi - region.lo).max())
    own = float(np.prod(region.hi - region.lo)) / float(np.prod(np.asarray(group.box, float)))
    return {"particles": float(group.number[0]) * (1.0 if "position" in group else own),
            "optical_depth": [float(tau.min()), float(tau.max())],
            "as_particles": None if depth is None else float(np.mean(depth > 0))}
