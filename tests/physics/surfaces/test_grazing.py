"""Plane layers beyond 88 degrees against Mitsuba's `volpath`.

A mean free path is 1000 units long and rays meet the layer near the origin, so that what Mitsuba moves rays off surfaces by, 1e-4
of such units, is nothing beside the depth at which light that grazes is scattered.
"""

import math

import numpy as np
import pytest

pytest.importorskip("renderers.mitsuba", exc_type=ImportError)

import drjit as dr
import mitsuba as mi

from bakery.physics.medium import analytic
from bakery.physics.surfaces.refine import refined
from bakery.physics.surfaces.slab import Slab

PATH, BLOCKS = 1000.0, 16
PAIRS = ((88.5, 45, 0.5), (89.9, 60, 2.0), (89.5, 88.5, 2.5), (89.9, 89.9, 3.0))  # from or to: the other way is the same
PASSES = 1 << 18  # samples


def seen(albedo, g, depth, wide, theta, theta_in, phi):
    """pi times the BRDF, and its standard error; depth and width in mean free paths."""
    sun = [math.sin(theta_in), 0, -math.cos(theta_in)]
    slab = mi.ScalarTransform4f().translate([0, 0, -depth * PATH / 2]).scale([wide * PATH, wide * PATH, depth * PATH / 2])
    scene = mi.load_dict({
        "type": "scene", "integrator": {"type": "volpath", "max_depth": 4000, "rr_depth": 50},
        "sun": {"type": "directional", "direction": sun, "irradiance": {"type": "rgb", "value": 1.0}},
        "slab": {"type": "cube", "to_world": slab, "bsdf": {"type": "null"}, "interior": {
            "type": "homogeneous", "sigma_t": 1 / PATH, "albedo": albedo, "phase": {"type": "hg", "g": g}}}})
    toward = np.array([math.sin(theta) * math.cos(phi), math.sin(theta) * math.sin(phi), math.cos(theta)])
    start, sampler, values = toward / toward[2] + [37.0, 91.0, 0.0], mi.load_dict({"type": "independent"}), []
    for block in range(BLOCKS):
        sampler.seed(block, PASSES // BLOCKS)
        ray = dr.zeros(mi.RayDifferential3f, PASSES // BLOCKS)
        ray.o, ray.d, ray.maxt = mi.Point3f(*start.tolist()), mi.Vector3f(*(-toward).tolist()), dr.largest(mi.Float)
        values.append(np.mean(np.array(scene.integrator().sample(scene, sampler, ray)[0])[0]))
    values = np.array(values) * math.pi / math.cos(theta_in)
    return values.mean(), values.std(ddof=1) / math.sqrt(BLOCKS)


@pytest.mark.slow
@pytest.mark.parametrize("albedo, g, depth, wide", [(0.9, 0.0, math.inf, 60), (0.99, 0.85, math.inf, 200), (0.9, 0.5, 1.0, 100)])
def test_light_that_grazes_is_volpaths(albedo, g, depth, wide):
    """Half spaces and a thin layer, by the stated error and eight standard errors of 16 blocks: 1e-5 for twelve pairs."""
    mi.set_variant("llvm_ad_rgb")
    theta, phase, _, _ = analytic.tabulated("hg", 1e-3, 1, g=[g])
    solution, change = refined(Slab(theta, phase[0], albedo, depth), 0.01)
    for out, into, phi in PAIRS:
        mean, error = seen(albedo, g, min(depth, wide), wide, math.radians(out), math.radians(into), phi)
        value = float(solution.reflection(math.cos(math.radians(out)), math.cos(math.radians(into)), phi))
        print(albedo, g, out, into, value, mean, error)
        assert error < 0.06 * mean and abs(value - mean) < change * value + 8 * error
