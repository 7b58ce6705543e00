"""The methods of a scene: which passes make its picture, and what is to be said of them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from renderers import colour
from renderers.discrete import detail, explicit, place, query, splat, walk
from renderers.discrete.medium import classes_of, medium, without_peak
from renderers.progressive import Part

_LAYERS = ("order0", "order1", "order2", "orders")
_HALF = 0.5


class Method(NamedTuple):
    """How a scene is rendered.

    parts : of `renderers.progressive`
    depth : (H, W) m, up to which particles are particles; None where the method tells no such depths
    reasons : sentences
    figures : what the report says besides
    """

    parts: tuple
    depth: np.ndarray | None
    reasons: list
    figures: dict


def prepare(job, world, tolerance, seed) -> Method:
    """The method that a scene asks for.

    Parameters
    ----------
    job : `renderers.running.Render`
    world : `renderers.mitsuba.world.World`
    tolerance : relative deviation of a pixel that taking the continuous medium for particles may make
    seed : of the passes
    """
    values, asset, group = job.scene.values, job.asset, job.asset.discrete
    settings, name = values.discrete, values.discrete.method
    height, width = world.size
    region = place.region_of(job.scene, group)
    waves = np.asarray(asset.wavelength, float)
    to_rgb, to_waves = colour.srgb_matrix(waves), colour.spread_matrix(waves)
    pixel = float(np.median(world.camera.angle(height, width)))
    baked = classes_of(group)
    angle = 0.0 if name == "explicit" or settings.peak == "keep" else _HALF * pixel if settings.peak == "auto" else settings.peak
    classes = without_peak(baked, angle)
    discs = place.discs_of(group, region, settings.velocity, settings.time)
    reasons = [_peak(classes, angle)]
    tabulated, order = medium(classes, discs, to_rgb, to_waves)
    depth, passes = None, [("walk", walk.one_pass, walk.Discs(tabulated))]
    if name == "continuous":
        passes = [("walk", walk.one_pass, walk.Discs(tabulated, later=0.0))]
        depth = np.zeros((height, width))
    elif name in ("particles", "auto"):
        depth = np.full((height, width), np.inf)
        if name == "auto":
            depth = detail.depths(world, tabulated, world.camera, height, width, tolerance, seed)
            reasons.append(_detail(depth, tolerance))
        later = np.inf if name == "particles" else 0.0
        passes = [("walk", walk.one_pass, walk.Discs(tabulated, later=later, splatted=True))]
        if depth.max() > 0 and world.light_names:
            how = splat.plan(tabulated, world.camera, height, width, depth, drawn=name == "auto")
            passes.append(("splat", splat.one_pass, (tabulated, how)))
    elif name == "query":
        passes = [("walk", walk.one_pass, _query(classes, discs, order, tabulated, settings.footprint, world, region))]
        reasons.append(f"queries of the paper, cylinders of {settings.footprint:g} pixels: their mean is not the continuous "
                       "medium's")
    elif name == "explicit":
        passes = [("walk", walk.one_pass, _spheres(group, baked, discs, tabulated, order, waves))]
        reasons.append("spheres of geometrical optics: without diffraction, and with the index of the middle wavelength")
    lights = world.light_names
    everywhere = np.full((height, width), np.inf) if depth is None else depth
    parts = tuple(Part(part, _pass(function, world, what, height, width, seed, everywhere, lights))
                  for part, function, what in passes)
    return Method(parts, depth, reasons, _figures(group, classes, region, depth))


def _pass(function, world, what, height, width, seed, depth, lights):
    """A pass as `Part` takes it: its number -> layers."""

    def one(number):
        by_order, by_light = function(world, what, world.camera, height, width, number, seed, discrete=depth, lights=len(lights))
        return {"": by_order.sum(axis=0)} | dict(zip(_LAYERS, by_order)) \
            | {f"light.{name}": image for name, image in zip(lights, by_light)}

    return one


def _query(classes, discs, order, tabulated, footprint, world, region):
    """Cylinders as wide as a share of a pixel where the medium begins (Eq. 23)."""
    origin = world.camera.origin
    nearest = float(np.linalg.norm(np.maximum(np.maximum(region.lo - origin, origin - region.hi), 0.0)))
    nearest = max(nearest, 0.01 * float(np.linalg.norm(region.hi - region.lo)))
    pixel = math.sqrt(np.linalg.norm(np.cross(world.camera.right, world.camera.down)))
    radius = math.sqrt(footprint * pixel**2 / math.pi) * nearest
    reach = np.broadcast_to(math.pi * (classes.radius[order] + radius) ** 2, classes.extinction.shape)
    cylinders = discs(reach, classes.density[order], order)
    return query.Query(tabulated._replace(discs=cylinders), np.ascontiguousarray(classes.extinction[:, order].T),
                       np.ascontiguousarray(classes.scattering[:, order].T), radius)


def _spheres(group, classes, discs, tabulated, order, waves):
    """Spheres of the classes' radii and their components' indices."""
    parts = [group[name] for name in group.classes().names]
    host, middle = np.asarray(group.host, float), int(np.argsort(waves)[len(waves) // 2])
    index = np.array([part.n[middle] / host[middle] for part in parts], float)
    absorption = np.array([4 * math.pi * np.asarray(part.k, float) / (waves * 1e-6) for part in parts])
    reach = np.broadcast_to(math.pi * classes.radius[order] ** 2, classes.extinction.shape)
    of = classes.component[order]
    return explicit.Spheres(tabulated._replace(discs=discs(reach, classes.density[order], order)), index[of],
                            np.ascontiguousarray(absorption[of]))


def _peak(classes, angle):
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


def _figures(group, classes, region, depth):
    tau = classes.sigma_t * float((region.hi - region.lo).max())
    own = float(np.prod(region.hi - region.lo)) / float(np.prod(np.asarray(group.box, float)))
    return {"particles": float(group.number[0]) * (1.0 if "position" in group else own),
            "optical_depth": [float(tau.min()), float(tau.max())],
            "as_particles": None if depth is None else float(np.mean(depth > 0))}
