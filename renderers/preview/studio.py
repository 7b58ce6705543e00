"""The studio of the preview: a cube of the medium on checkered ground, under light from all sides, most of it from two.

The light comes from afar and is one map of directions: a key light, a rim light and a dim sky.  The lights are wide and
soft, so paths that have scattered many times meet similar radiance whatever direction they leave in: that keeps
noise low at few samples.  Everything but the medium is grey.
"""

import numpy as np

# In edges of the block, z up, the block's foot at the origin; field of view across the width.
CAMERA, TARGET, FIELD_OF_VIEW = np.array([-2.15, -3.7, 1.65]), np.array([0.0, 0.0, 0.44]), np.radians(29.0)
LIFT = 0.002  # of the block above the ground: coinciding surfaces would flicker
# Azimuth (0 where the camera looks, positive to the right), elevation, radius in degrees; radiance at the centre, from
# where it falls to 0 at the radius.
KEY = (-98.0, 44.0, 88.0, 1.8)
RIM = (50.0, 36.0, 52.0, 2.1)
SKY = 0.18
BRIGHT, DARK, FAR = 0.38, 0.23, 0.07  # reflectance of the checks, and of the ground far away
# Ends of the names of parameters that differ from wavelength to wavelength.
OPAQUE = ("interior_medium.albedo.value.value", "interior_medium.sigma_t.value.value", ".eta", ".eta.value", ".k.value", ".alpha",
          "reflectance.value")
CHECK, FADE, CHECKED = 0.25, 2.4, 16.0  # width of a check, where checks have faded by half, width of the checked part


def _towards(azimuth, elevation):
    """Unit vector, from degrees."""
    azimuth, elevation = np.radians([azimuth, elevation])
    x, y = (TARGET - CAMERA)[:2] / np.hypot(*(TARGET - CAMERA)[:2])
    right, ahead = np.sin(azimuth) * np.cos(elevation), np.cos(azimuth) * np.cos(elevation)
    return np.array([ahead * x + right * y, ahead * y - right * x, np.sin(elevation)])


def sky(direction):
    """Radiance from (..., 3) unit vectors."""
    radiance = np.full(direction.shape[:-1], SKY)
    for azimuth, elevation, radius, peak in (KEY, RIM):
        angle = np.degrees(np.arccos(np.clip(direction @ _towards(azimuth, elevation), -1.0, 1.0)))
        x = np.clip(1.1 * (1 - angle / radius), 0.0, 1.0)
        radiance += peak * x * x * (3 - 2 * x)
    return radiance


def sky_map(height=128):
    """(height, 2 height) radiance by latitude and longitude, as Mitsuba's `envmap` takes it when its y axis is turned to z."""
    theta = (np.arange(height) + 0.5) / height * np.pi
    phi = (np.arange(2 * height) + 0.5) / height * np.pi
    theta, phi = np.meshgrid(theta, phi, indexing="ij")
    return sky(np.stack([np.sin(theta) * np.sin(phi), np.sin(theta) * np.cos(phi), np.cos(theta)], axis=-1)).astype(np.float32)


def reflectance(x, y):
    """Of the ground."""
    checks = np.where((np.floor(x / CHECK) + np.floor(y / CHECK)) % 2, DARK, BRIGHT)
    return FAR + (checks - FAR) / (1 + (np.hypot(x, y) / FADE) ** 4)


def scene(mi, medium, width, height, rr_depth):
    """The studio with a block of `medium` (a dict for Mitsuba, its coefficients per edge of the block)."""
    to = mi.ScalarTransform4f
    block = {"type": "cube", "to_world": to().translate([0, 0, 0.5 + LIFT]) @ to().scale(0.5), "bsdf": {"type": "null"},
             "interior": medium}
    return furnished(mi, {"block": block}, width, height, {"type": "volpath", "max_depth": 100_000, "rr_depth": rr_depth})


def furnished(mi, shown, width, height, integrator, target=TARGET):
    """The studio with shapes (dicts for Mitsuba by name) on its ground; the camera stays and looks at `target`."""
    import drjit as dr

    to = mi.ScalarTransform4f
    centre = to().translate([0.5, 0.5, 0])
    x = (np.arange(int(32 * CHECKED)) + 0.5) / 32 - CHECKED / 2
    ground = mi.Bitmap(reflectance(x, x[:, None]).astype(np.float32)[..., None])
    built = mi.load_dict({
        "type": "scene",
        "integrator": integrator,
        "sensor": {"type": "perspective", "fov": float(np.degrees(FIELD_OF_VIEW)),
                   "to_world": to().look_at(origin=CAMERA.tolist(), target=list(target), up=[0, 0, 1]),
                   "film": {"type": "hdrfilm", "width": width, "height": height, "pixel_format": "luminance",
                            "rfilter": {"type": "box"}},
                   "sampler": {"type": "independent"}},
        "sky": {"type": "envmap", "bitmap": mi.Bitmap(sky_map()[..., None]), "to_world": to().rotate([1, 0, 0], 90)},
        "ground": {"type": "rectangle", "to_world": to().scale([500, 500, 1]),
                   "bsdf": {"type": "diffuse", "reflectance": {
                       "type": "bitmap", "bitmap": ground, "raw": True, "wrap_mode": "clamp",
                       "to_uv": centre @ to().scale(1000 / CHECKED) @ centre.inverse()}}},
        **shown,
    }, optimize=False)  # optimised, the order of objects changes from run to run, and with it the noise
    # As variables, not constants of the compiled kernel: wavelengths and assets share it, half a second each.
    values = mi.traverse(built)
    for key in values.keys():  # noqa: SIM118  not a dict
        if key.split(".")[0] in shown and key.endswith(OPAQUE):
            dr.make_opaque(values[key])
    return built


def features(width, height, tau, grid=3):
    """What the camera sees of the studio itself, without noise: where the picture may have edges, (height, width, 5) 0 to 1.

    Opacity of the block, where it is entered by the face towards -x, -y, +z, and the ground's reflectance as far as it shines
    through.

    width, height : pixels;  tau : 1, optical thickness of the block along an edge;  grid : samples a pixel, along each side
    """
    forward = (TARGET - CAMERA) / np.linalg.norm(TARGET - CAMERA)
    right = np.cross(forward, [0, 0, 1])
    right /= np.linalg.norm(right)
    reach = np.tan(FIELD_OF_VIEW / 2)
    across = (2 * (np.arange(grid * width) + 0.5) / (grid * width) - 1) * reach
    down = (2 * (np.arange(grid * height) + 0.5) / (grid * height) - 1) * reach * height / width
    direction = forward + across[None, :, None] * right - down[:, None, None] * np.cross(right, forward)
    length = np.linalg.norm(direction, axis=-1, keepdims=True)
    low, high = np.array([-0.5, -0.5, LIFT]), np.array([0.5, 0.5, 1 + LIFT])
    bounds = np.sort([(low - CAMERA) / direction, (high - CAMERA) / direction], axis=0)
    enter, leave = bounds[0].max(axis=-1), bounds[1].min(axis=-1)
    chord = np.maximum(leave - enter, 0.0) * length[..., 0]
    opacity = 1 - np.exp(-tau * chord)
    face = (bounds[0].argmax(axis=-1)[..., None] == np.arange(3)) * 0.5 * opacity[..., None]
    on_ground = CAMERA - CAMERA[2] / np.minimum(direction[..., 2:], -1e-6) * direction
    ground = reflectance(on_ground[..., 0], on_ground[..., 1]) * (1 - opacity)
    fine = np.concatenate([opacity[..., None], face, ground[..., None]], axis=-1)
    return fine.reshape(height, grid, width, grid, 5).mean(axis=(1, 3))
