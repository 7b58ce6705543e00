"""The studio of the preview: a seamless ground, a cube of the medium upon it, and light from all sides, most of it from two.

Light comes from far away and is drawn as one map of directions: a key light, a rim light and a dim sky.  All three are soft
and together they leave no direction dark, so a path that has lost its way in the medium still ends at about the same
radiance as its neighbours: that, and not the number of samples, makes the picture quiet.
"""

from __future__ import annotations

import numpy as np

GROUND, CHECK = 0.42, 0.09  # reflectance of the bright checks, and what the dark ones have less
EDGE_OF_CHECKS = 3.2  # edges of the block, where the checks have faded by half
CHECKED = 16.0  # width of the ground's picture, in block edges


def _towards(azimuth, elevation):
    """Unit vector, degrees; azimuth 0 is where the camera looks, positive to the right; elevation above the ground."""
    azimuth, elevation = np.radians([azimuth, elevation])
    right, ahead = np.sin(azimuth) * np.cos(elevation), np.cos(azimuth) * np.cos(elevation)
    view = np.array(TARGET[:2]) - np.array(CAMERA[:2])
    x, y = view / np.hypot(*view)
    return np.array([ahead * x + right * y, ahead * y - right * x, np.sin(elevation)])


CAMERA, TARGET, FIELD_OF_VIEW = (-2.15, -3.7, 1.75), (0.0, 0.0, 0.44), 30.0  # block edges; degrees across the width
# direction (degrees as in `_towards`), radiance in the middle, radius in degrees, how much of the radius is edge
KEY = (-118.0, 48.0), 1.6, 75.0, 0.9
RIM = (52.0, 32.0), 2.6, 45.0, 0.9
HORIZON, ZENITH = 0.26, 0.20


def sky(direction):
    """Radiance from (..., 3) directions, z up."""
    z = np.clip(direction[..., 2], 0.0, 1.0)
    radiance = ZENITH + (HORIZON - ZENITH) * np.exp(-((z / 0.35) ** 2))
    for towards, peak, radius, soft in (KEY, RIM):
        angle = np.degrees(np.arccos(np.clip(direction @ _towards(*towards), -1, 1)))
        x = np.clip((radius - angle) / (soft * radius), 0.0, 1.0)
        radiance = radiance + peak * x * x * (3 - 2 * x)
    return radiance


def _map(height=256):
    """The sky as a picture: longitude by latitude, as Mitsuba's `envmap` reads it when turned z up."""
    v = (np.arange(height) + 0.5) / height * np.pi
    u = (np.arange(2 * height) + 0.5) / (2 * height) * 2 * np.pi
    theta, phi = np.meshgrid(v, u, indexing="ij")
    direction = np.stack([np.sin(theta) * np.sin(phi), np.sin(theta) * np.cos(phi), np.cos(theta)], axis=-1)
    return sky(direction).astype(np.float32), direction, np.sin(theta)


def irradiance():
    """Of the open ground, by the map's own pixels."""
    radiance, direction, sine = _map()
    cell = (np.pi / len(radiance)) ** 2
    return float(np.sum(radiance * sine * np.clip(direction[..., 2], 0, None)) * cell)


def _ground():
    """The ground's reflectance: checks of a quarter of the edge that fade into a ground as bright as the horizon."""
    x = (np.arange(int(32 * CHECKED)) + 0.5) / 32 - CHECKED / 2
    dark = (np.floor(4 * x)[:, None] + np.floor(4 * x)) % 2
    far = 1 / (1 + (np.hypot(x[:, None], x) / EDGE_OF_CHECKS) ** -4.0)
    horizon = np.pi * HORIZON / irradiance()
    return ((1 - far) * (GROUND - CHECK * dark) + far * horizon).astype(np.float32)[..., None]


def scene(mi, medium, width, height, max_depth=100_000, rr_depth=100):
    """The studio with a block of `medium`, in units of the block's edge, z up.

    Parameters
    ----------
    medium : dict for `mitsuba.load_dict`, with coefficients per edge of the block
    width, height : pixels
    """
    place = mi.ScalarTransform4f
    centre = place().translate([0.5, 0.5, 0])
    return mi.load_dict({
        "type": "scene",
        "integrator": {"type": "volpath", "max_depth": max_depth, "rr_depth": rr_depth},
        "sensor": {"type": "perspective", "fov": FIELD_OF_VIEW,
                   "to_world": place().look_at(origin=CAMERA, target=TARGET, up=[0, 0, 1]),
                   "film": {"type": "hdrfilm", "width": width, "height": height, "pixel_format": "luminance",
                            "rfilter": {"type": "box"}},
                   "sampler": {"type": "independent"}},
        "sky": {"type": "envmap", "bitmap": mi.Bitmap(_map()[0][..., None]),
                "to_world": place().rotate([1, 0, 0], 90)},
        "ground": {"type": "rectangle", "to_world": place().scale([500, 500, 1]),
                   "bsdf": {"type": "diffuse", "reflectance": {
                       "type": "bitmap", "bitmap": mi.Bitmap(_ground()), "raw": True, "filter_type": "bilinear",
                       "wrap_mode": "clamp", "to_uv": centre @ place().scale(1000 / CHECKED) @ centre.inverse()}}},
        "block": {"type": "cube", "to_world": place().translate([0, 0, 0.502]) @ place().scale(0.5), "bsdf": {"type": "null"},
                  "interior": medium},
    }, optimize=False)  # optimised, the order of objects changes from run to run, and with it the noise
