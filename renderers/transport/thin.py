"""Which media are thin, so that flights through them take light samples of their own."""

from __future__ import annotations

import numpy as np

from renderers.transport import regions
from renderers.transport.airlight import Airlight
from renderers.transport.regions import Grid, Medium, Mesh

THICKEST = 1.0


def airlight(scene, entries, unit):
    """`Airlight` of a scene; None where no medium is thin, or nothing shines.

    entries : of `scene.Scene`, by the numbers of their media;  unit : m, length of 1 in the loop
    """
    if not scene.scene.emitters():
        return None
    thin = [_thin(scene, entry, unit) for entry in entries.values()]
    hidden = sum(1 << number for number, entry in entries.items() if not isinstance(entry, Medium) and not entry.matched)
    return Airlight(scene, thin, hidden) if any(thin) else None


def _thin(scene, entry, unit):
    """Whether light samples reach scatterings in a medium, and a way through it has little optical depth."""
    if isinstance(entry, Medium):
        if isinstance(entry.region, Grid):
            return False
        size, scatterer = _size(scene, entry.region, unit), entry.scatterer
    elif entry.matched:
        size, scatterer = np.ptp(entry.vertices, axis=0), entry.medium
    else:
        return False
    depth = float(np.max(scatterer.sigma_t)) * float(np.linalg.norm(size))
    return 0 < depth < THICKEST


def _size(scene, region, unit):
    """Of a box around a region, m; of what is everywhere that around all surfaces."""
    if isinstance(region, regions.Everywhere):
        return np.array([float(scene.extent[1][0]) * unit])
    if isinstance(region, Mesh):
        return np.ptp(region.vertices, axis=0)
    return np.asarray(region.hi, float) - region.lo
