"""Where flights take light samples of their own (`airlight`): in thin media with a small lamp.

Both are told by sizes, not by a trial: the time of one is another each time, and pictures would be, too.
"""

from __future__ import annotations

import drjit as dr
import numpy as np

import renderers.mitsuba  # noqa: F401  before mitsuba: it finds LLVM
from renderers.transport import regions
from renderers.transport.airlight import Airlight
from renderers.transport.regions import Grid, Medium, Mesh

import mitsuba as mi  # isort: skip

# Optical depth of a medium along its box, or as far as the camera sees if that is less; half of the diagonal of the box around a
# lamp, of that distance.  `benchmarks/haze.py`, variance times time with over without: SHOWN
THICKEST, LARGEST = 2.0, 0.05
_RAYS = 1024  # of the camera, at most, the median of which tells how far it sees


def airlight(scene, entries, world):
    """`Airlight` of a scene; None where no medium is thin, or no lamp small.

    entries : of `scene.Scene`, by the numbers of their media;  world : `renderers.mitsuba.world.World`
    """
    sizes = {number: _size(entry) for number, entry in entries.items() if _lit(entry)}
    emitters = scene.scene.emitters()
    lamps = Airlight.places(emitters)[:, 3] if emitters else np.array([-1.0])
    if not sizes or np.all(lamps < 0):
        return None
    ahead = _ahead(scene, world) * world.unit
    if not np.any((lamps >= 0) & (lamps * world.unit <= LARGEST * ahead)):
        return None
    thin = np.zeros(len(entries), bool)
    for number, size in sizes.items():
        scatterer = entries[number].scatterer if isinstance(entries[number], Medium) else entries[number].medium
        thin[number] = 0 < float(np.max(scatterer.sigma_t)) * min(size, ahead) <= THICKEST
    hidden = sum(1 << number for number, entry in entries.items() if not isinstance(entry, Medium) and not entry.matched)
    return Airlight(scene, thin, hidden) if thin.any() else None


def _lit(entry):
    """Whether light samples reach scatterings in a medium, and its density is one number."""
    return not isinstance(entry.region, Grid) if isinstance(entry, Medium) else entry.matched


def _size(entry):
    """Diagonal of the box around a medium, m."""
    if not isinstance(entry, Medium) or isinstance(entry.region, Mesh):
        vertices = entry.region.vertices if isinstance(entry, Medium) else entry.vertices
        return float(np.linalg.norm(np.ptp(vertices, axis=0)))
    if isinstance(entry.region, regions.Everywhere):
        return np.inf
    return float(np.linalg.norm(np.asarray(entry.region.hi, float) - entry.region.lo))


def _ahead(scene, world):
    """Median of the distances from the camera to surfaces; the size of the scene where it sees few."""
    pixels = world.size[0] * world.size[1]
    pixel = mi.UInt32(np.linspace(0, pixels - 1, min(pixels, _RAYS)).astype(np.uint32))
    hit = scene.scene.ray_intersect_preliminary(mi.Ray3f(*scene.camera_ray(pixel, mi.Point2f(0.5))), coherent=False)
    median = float(np.median(np.array(dr.select(hit.is_valid(), hit.t, dr.inf))))
    return median if np.isfinite(median) else float(scene.extent[1][0])
