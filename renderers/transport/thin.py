"""Where flights take light samples of their own (`airlight`): in thin media in which a small lamp stands that lights the scene.

All are told by sizes and by lights as they shine unscattered, not by a trial: the time of one is another each time, and pictures
would be, too.
"""

import numpy as np

from renderers.transport import regions
from renderers.transport.airlight import Airlight
from renderers.transport.regions import Grid, Medium, Mesh

# Optical depth of a medium, along the diagonal of its box or from the camera to the nearest small lamp in it, whichever is less;
# half of the diagonal of the box around a lamp, of its distance from the camera.  `benchmarks/haze.py`, variance times time with
# over without: depth 0.4 under a lamp of size 0.01: 0.17 to 0.4, of 0.03 and of 0.2: 1.4; skies alone: 1.3; depth 1.3: 0.25 to 1,
# depth 5: 1.4.  Lamps, as one of all is drawn: of one 0.24, of six 0.41, of 101 in a street (depth 0.4) 1.03
THICKEST, LARGEST, MOST = 2.0, 0.02, 32
# Share of the light that small lamps bring (`World.small_share`), below which what is left to chance of them is not seen beside
# the rest.  Sky and a lamp, depth 0.3 and 1.5, variance times time with over without, aureoles left out: share 0.18: 0.4, 0.5;
# 0.028: 0.6, 0.04; 0.007: 1.4, 1.5; 0.001: 1.5, 1.4
LEAST = 0.02


def airlight(scene, entries, world):
    """`Airlight` of a scene; None where no medium is thin, no small lamp in it, too many lights, or little light of small ones.

    entries : of `scene.Scene`, by the numbers of their media;  world : `renderers.mitsuba.world.World`
    """
    emitters, spheres = small_lamps(scene, world)
    if not emitters or len(scene.scene.emitters()) > MOST or world.small_share < LEAST:
        return None
    middles = world.unit * spheres[:, :3]
    away = np.linalg.norm(middles - np.asarray(world.camera.origin, float), axis=1)
    thin = [_thin(entry, middles, away) for entry in entries.values()]
    hidden = sum(1 << number for number, entry in entries.items() if not isinstance(entry, Medium) and not entry.matched)
    return Airlight(scene, thin, hidden) if any(thin) else None


def small_lamps(scene, world):
    """Small lamps of a scene, and (n, 4) their middles and half-diagonals, in its unit; parameters as of `airlight`."""
    emitters = scene.scene.emitters()
    spheres = Airlight.anchors(emitters).reshape(-1, 4)
    away = np.linalg.norm(spheres[:, :3] - np.asarray(world.camera.origin, float) / world.unit, axis=1)
    small = np.flatnonzero((spheres[:, 3] >= 0) & (spheres[:, 3] <= LARGEST * away))
    return [emitters[number] for number in small], spheres[small]


def _thin(entry, lamps, away):
    """Whether light samples reach scatterings in a medium of one density, and it is thin as seen from the camera.

    lamps, away : (n, 3), (n,) places of lamps, and how far from the camera, m
    """
    if isinstance(entry.region, Grid) if isinstance(entry, Medium) else not entry.matched:
        return False
    low, high = _box(entry)
    away = away[np.all((lamps >= low) & (lamps <= high), axis=1)]
    sigma = float(np.max((entry.scatterer if isinstance(entry, Medium) else entry.medium).sigma_t))
    return len(away) > 0 and 0 < sigma * min(float(np.linalg.norm(high - low)), away.min()) <= THICKEST


def _box(entry):
    """Corners of the box around a medium, m."""
    if isinstance(entry, Medium) and isinstance(entry.region, regions.Everywhere):
        return np.full(3, -np.inf), np.full(3, np.inf)
    if isinstance(entry, Medium) and not isinstance(entry.region, Mesh):
        return np.asarray(entry.region.lo, float), np.asarray(entry.region.hi, float)
    vertices = entry.region.vertices if isinstance(entry, Medium) else entry.vertices
    return vertices.min(axis=0), vertices.max(axis=0)
