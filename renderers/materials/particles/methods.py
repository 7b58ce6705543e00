"""The methods of a scene: which passes make its picture, and what is to be said of them."""

import math
from typing import NamedTuple

import numpy as np

from bakery.kernels import BOX
from renderers import colour
from renderers.materials.particles import place, walk
from renderers.materials.particles.declared import methods
from renderers.materials.particles.medium import Classes, Medium, classes_of, in_bands, medium, peak_of, without_peak
from renderers.pictures.engine import Part, layers_of
from renderers.pictures.passes import Method
from renderers.scene import budget
from renderers.scene.declaration import settled


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

    job : `renderers.pictures.running.Render`
    world : `renderers.mitsuba.world.World`
    seed : of the passes
    tolerance : relative deviation of a pixel that taking the continuous medium for particles may make; the scene's if None
    """
    # a pixel of a pilot shows more particles, which deviate less: it has the depths that pixels of the picture have
    tolerance = (budget.of(job.scene).approximations if tolerance is None else tolerance) / world.coarser
    (height, width), name = world.size, settled(methods(), job.scene.values.method)
    angle = peak_angle(job.scene.values.materials[0], world)
    setup = _setup(job, world, angle)
    declared = methods()[name]
    passes, depth, reasons = declared.passes(setup, tolerance, seed)
    lights = world.light_names
    everywhere = np.full((height, width), np.inf) if depth is None else depth
    parts = tuple(listed if isinstance(listed, Part) else
                  Part(listed[0], _pass(*listed[1:], world, height, width, seed, everywhere, lights)) for listed in passes)
    figures = _figures(setup, depth) | {"layers": _layers(depth), "left_out": world.left_out()}
    reasons = [peak_sentence(setup.classes, angle), *filter(None, [declared.leaves_out]), *reasons, *figures["left_out"]]
    return Method(name, parts, reasons,
                  lambda estimate: figures, features=None if depth is None else lambda quality: _features(setup, seed),
                  apart=("walk",) if depth is None else ("splat",))  # without a depth particles show in all of their light


def _features(setup, seed):
    """What the camera sees, with the particles as a medium: those that are seen as such are in no filter."""
    from renderers.transport import features, regions
    from renderers.transport.scattering import scatterer

    region, medium = setup.region, setup.medium
    # where it scatters light to plays no role
    haze = scatterer(medium.sigma_t, medium.albedo[-1], np.array([0.0, math.pi]), np.ones((len(medium.sigma_t), 2)))
    where = regions.Box(region.lo, region.hi) if region.kind == BOX else regions.Grid(region.lo, region.hi, region.values)
    return features.first_hits(setup.world, [regions.Medium(where, haze)], medium, seed)


def peak_angle(settings, world):
    """Within which the forward peak counts as unscattered, rad; 0: nothing does."""
    if not methods()[settings.method].peak or settings.peak == "keep":
        return 0.0
    return peak_of(settings.peak, world)


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


def _pass(function, method, world, height, width, seed, depth, lights):
    """A pass as `Part` takes it: its number -> layers."""

    def one(number):
        if function is walk.one_pass and method.squares is None and world.extended:
            method.squares = walk.squares_of(world, world.camera, height, width)
        by_order, by_light = function(world, method, world.camera, height, width, number, seed, discrete=depth,
                                      lights=len(lights))
        # walks have all layers; what splats leave black takes memory for nothing
        return {name: image for name, image in layers_of(by_order, by_light, lights).items()
                if not name or function is walk.one_pass or image.any()}

    return one


def peak_sentence(classes, angle):
    if angle == 0:
        return "the forward peak of the phase functions is kept"
    share = 100 * classes.peak
    return (f"light scattered within {math.degrees(angle):.3g} degrees of forward counts as unscattered: {share.min():.3g} to "
            f"{share.max():.3g} % of the extinction; halos narrower than that are left out (peak: keep)")


def _layers(depth):
    """Layers `detail` and `method` of the picture."""
    if depth is None:
        return {}
    return {"detail": np.minimum(depth, 1e30), "method": np.where(depth == 0, 0.0, np.where(np.isinf(depth), 1.0, 2.0))}


def _figures(setup, depth):
    region, group = setup.region, setup.group
    tau = setup.classes.sigma_t * float((region.hi - region.lo).max())
    volume = float(np.prod(region.hi - region.lo)) / float(np.prod(np.asarray(group.box, float)))
    return {"particles": float(group.number[0]) * (1.0 if "position" in group else volume),
            "optical_depth": [float(tau.min()), float(tau.max())],
            "as_particles": None if depth is None else float(np.mean(depth > 0))}
