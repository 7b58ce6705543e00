"""What fog in screen space needs of a recipe: how deep kernels, how good phase functions."""

import math

import numpy as np

from renderers.scene.budget import as_much
from renderers.scene.requirements import Knob, Need

# Rays that measure distances: one a pixel up to this many, 0.6 s of a core.  With every fourth in a row a gap of two pixels in a
# wall at two metres hid a lamp at twenty, and kernels were a seventh as deep as the picture (tests/adversarial.py)
_RAYS = 400_000
_DEEPER = 1.25  # margin of the depth: in pictures of more pixels the farthest lies between rays
# Tables of the kernel are the same whatever `beam.tolerance` says: photons only measure their error, 1.4 % in fog (docs/beam.md)
_STATED, _KERNELS = 0.1, 0.014
# True error of the phase function over the integrated tolerance that was asked for: 0.08 to 0.11 in fog (docs/trade.md); a
# margin of two
_TRUE = 0.2
# Coarser tables of angles than 1 % (integrated) asks for have kinks that no 2048 Legendre orders hold: kernels then come from the
# small-angle model and are 24 % off, in fog (3 % and 10 %), where they are 1.4 % off by transport
_MOST, _LEAST = 0.01, 1e-4


def needs(about) -> list[Need]:
    """Requirements of the stages optics, medium and beam; see `renderers.scene.requirements`."""
    column = about.measured(_columns)
    depth = column * about.medium.sigma_t.max()
    deepest, median, wanted = float(depth.max()), float(np.median(depth)), about.tables
    reason = f"optical depth {deepest:.3g} at the farthest of {len(depth):,} rays, {median:.2g} in the middle of them"
    value = float(np.clip(_DEEPER * deepest, 0.01, 1000))
    why, lacking = f"the optical depth of {deepest:.3g} and a quarter more", []
    if _DEEPER * deepest > 1000:
        why = "tables end there"
        lacking.append(f"kernels of a depth of {deepest:.3g} are wanted; tables end at 1000")
    if wanted < _KERNELS:
        lacking.append(f"kernels within {100 * wanted:.2g} % of transport are wanted, those of fog are within "
                       f"{100 * _KERNELS:g} %, {as_much(_KERNELS / wanted)}")
    knobs = (Knob("beam.depth", value, f"{value:.4g}", why),
             Knob("beam.tolerance", _STATED, f"{100 * _STATED:g}%", "it changes no table: photons only measure their error",
                  larger=False))
    needed = [Need("medium", True, reason), Need("beam", True, reason, knobs, "; ".join(lacking))]
    return needed if about.recipe.particles is None else [_optics(about, median, reason), *needed]


def _optics(about, median, reason) -> Need:
    """A wrong share of the light at each scattering adds up over as many scatterings as the optical depth.

    The integral of |f - f_ref| is twice the share of light that goes elsewhere.
    """
    wanted = 2 * about.tables / max(median, 1.0) / _TRUE
    value = float(np.clip(wanted, _LEAST, _MOST))
    times = "once at most" if median <= 1 else f"{median:.2g} times"
    why = f"light is scattered {times}, and tables may take {100 * about.tables:.2g} % of the picture"
    knobs = (Knob("tolerance", value, f"{100 * value:.3g}%", why, larger=False),
             Knob("measure", "integrated", "integrated", "the filter reads shares of light, no single angle",
                  words=("integrated", "pointwise")))
    lacking = "" if wanted >= _LEAST else f"phase functions of {100 * wanted:.2g} % are wanted, {100 * _LEAST:g} % are asked " \
        f"for, {as_much(_LEAST / wanted)}"
    return Need("optics", True, reason, knobs, lacking)


def _columns(about):
    """Relative density integrated along rays of the picture to their surfaces, (N,) m."""
    from renderers import fog
    from renderers.fog.view import finite

    scene, values = about.scene, about.scene.values
    density = fog._density(scene)
    if hasattr(values.picture, "mitsuba"):
        from renderers.mitsuba.world import World

        world = World(scene.file(values.picture.mitsuba), values.picture.unit)
        (height, width), camera = world.size, world.camera
        rays = camera.rays(height, width)[_some(height, width)].reshape(-1, 3)
        origin, far = np.tile(camera.origin, (len(rays), 1)), world.trace(np.tile(camera.origin, (len(rays), 1)), rays, np.inf)
    else:
        picture = fog._picture(scene, None, None, None, None)
        height, width = picture.distance.shape
        sampled = _some(height, width)
        rays, far = picture.camera.rays(height, width)[sampled].reshape(-1, 3), picture.distance[sampled].ravel()
        origin = np.tile(picture.camera.origin, (len(rays), 1))
    far, _ = finite(scene, density, origin[0], far[None])
    return density.integrals(origin, rays, far[0])[:, 0]


def _some(height, width):
    """Pixels of a picture that are measured."""
    step = math.ceil(math.sqrt(height * width / _RAYS))
    return np.s_[::step, ::step]
