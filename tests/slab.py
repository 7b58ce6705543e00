"""A slab of a medium in the sun: its asset, closed forms of light that is scattered once, and Mitsuba for all of it.

The slab is 1 m thick and 20 m wide, seen along its normal.
"""

import math

import numpy as np
import pytest

from bakery.physics.medium.phase import cumulative, mean_cosine, normalised
from bakery.store.tree import Dataset
from tests.samples import small_asset, with_member

SIGMA_S, SIGMA_A = np.array([0.9, 1.5]), np.array([0.05, 0.3])  # 1/m, at 610 and 465 nm


def with_medium(tree, **data):
    """The asset's tree with other figures in its medium."""
    for name, values in data.items():
        tree = with_member(tree, f"medium/{name}", Dataset(values, tree[f"medium/{name}"].units, name))
    return tree


def medium_of_lobes(lobes):
    """An asset's tree: lobes, the same at both wavelengths; coefficients that differ, of a thickness of about one in 1 m."""
    tree = with_member(small_asset(), "optics", None)
    theta = tree["medium/theta"].data
    phase = np.tile(normalised(theta, lobes(theta))[0], (2, 1))
    for name in {"s11", "s12", "s33", "s34"} & tree["medium"].members.keys():
        tree = with_member(tree, f"medium/{name}", None)
    return with_medium(tree, phase=phase, cdf=cumulative(theta, phase), g=mean_cosine(theta, phase), sigma_s=SIGMA_S,
                       sigma_a=SIGMA_A, sigma_t=SIGMA_S + SIGMA_A, albedo=SIGMA_S / (SIGMA_S + SIGMA_A))


def once(angle: float, sigma_s, sigma_t):
    """Radiance of light that is scattered once under irradiance 1 by a deflection of `angle` (rad), over the phase function."""
    mu = abs(math.cos(angle))
    if angle < math.pi / 2:  # from behind
        rate = sigma_t * (1 / mu - 1)
        return sigma_s * np.exp(-sigma_t) * (-np.expm1(-rate) / rate if rate.all() else 1)
    rate = sigma_t * (1 + 1 / mu)
    return sigma_s * -np.expm1(-rate) / rate


def in_mitsuba(asset, sigma_s, sigma_t, angle: float) -> tuple[np.ndarray, np.ndarray]:
    """(3,) radiance of the slab by the asset's own table, and its standard error."""
    mi = pytest.importorskip("mitsuba")
    import renderers.mitsuba  # noqa: F401, registers bakedphase

    mi.set_variant("scalar_rgb")
    scene = mi.load_dict({
        "type": "scene", "integrator": {"type": "volpath", "max_depth": -1, "rr_depth": 1000},
        "sensor": {"type": "orthographic", "to_world": mi.ScalarTransform4f().look_at([0, 0, 5], [0, 0, 0], [0, 1, 0])
                   @ mi.ScalarTransform4f().scale(0.25),
                   "film": {"type": "hdrfilm", "width": 16, "height": 16, "rfilter": {"type": "box"}, "pixel_format": "rgb",
                            "component_format": "float32"}, "sampler": {"type": "independent", "sample_count": 512}},
        "sun": {"type": "directional", "direction": [math.sin(angle), 0, math.cos(angle)],
                "irradiance": {"type": "rgb", "value": [1.0, 1.0, 1.0]}},
        "slab": {"type": "cube", "to_world": mi.ScalarTransform4f().scale([10, 10, 0.5]), "bsdf": {"type": "null"},
                 "interior": {"type": "homogeneous", "scale": float(sigma_t.max()),
                              "sigma_t": {"type": "rgb", "value": (sigma_t / sigma_t.max()).tolist()},
                              "albedo": {"type": "rgb", "value": (sigma_s / sigma_t).tolist()},
                              "phase": {"type": "bakedphase", "filename": str(asset)}}},
    })
    pixels = np.array(mi.render(scene, seed=3)).reshape(-1, 3)
    return pixels.mean(axis=0), pixels.std(axis=0, ddof=1) / math.sqrt(len(pixels))
