"""The tables that stand for a narrow beam: which model makes them, and how many photons show their error."""

from typing import NamedTuple

import numpy as np

from bakery.physics.beam import build
from bakery.physics.beam.kinds import MEASURES
from bakery.physics.beam.photons import Counting
from bakery.physics.beam.predicted import MORE, MOST, first_photons

_FARTHEST = 5.0  # mfp, the last plane and ring in which photons are counted
_PLANES, _RINGS = 10, 50
_QUIET = 1 / 3  # of the tables' error: noise that more photons need not lower, as the tables themselves miss


class Tabulated(NamedTuple):
    """Tables of one wavelength."""

    values: dict[str, np.ndarray]  # measure or "small_angle" -> (D, U) r depth kernel
    model: str  # in `kinds.MODELS`, of the measures
    B: float  # rad^2, of the Gaussian lobe with the table's width
    errors: dict[str, tuple[float, float]]  # measure -> relative error against photons less their noise, and that noise
    photons: int  # counted for each


def counted_at(deepest):
    """Depths of planes (D,) and edges of rings (R + 1,) in which photons are counted, mfp, for tables down to `deepest`."""
    far = min(_FARTHEST, float(deepest))
    return far * np.arange(1, _PLANES + 1) / _PLANES, np.linspace(0, far, _RINGS + 1)


def tabulated(albedo, theta, phase, nodes, photons, tolerance, seed, stream) -> Tabulated:
    """Tables of all measures by the best model that can be had, held against photons.

    albedo : 0 to 1
    theta, phase : (A,) rad, 1/sr, linear in cos theta, normalised
    nodes : (depth, ratio) of `table.grid`
    photons : their number, or None: as many as it takes to show the tolerance, or that the tables miss it
    tolerance : error of the fluence with the photons' noise
    seed, stream : of the photons
    """
    medium = build.prepare(theta, phase)
    small = build.small_angle_table(medium, albedo, nodes[0][-1], nodes=nodes)
    model = build.model_of(medium)
    tables = dict.fromkeys(MEASURES, small)
    if model == "transport":
        tables = build.transport_tables(medium, albedo, nodes[0][-1], nodes=nodes)
    values = {name: table.value for name, table in tables.items()} | {"small_angle": small.value}
    if albedo == 0:
        return Tabulated(values, model, medium.planar.B, dict.fromkeys(MEASURES, (0.0, 0.0)), photons or 0)
    counting = Counting(albedo, theta, phase, *counted_at(nodes[0][-1]), (seed, stream))
    counting.follow(photons or first_photons(tolerance))
    measured = build.errors(tables, counting)
    while not photons and counting.photons < MOST:
        error, noise = measured["fluence"]
        if error + noise <= tolerance or noise < _QUIET * error:
            break
        counting.follow(min(MORE * counting.photons, MOST))
        measured = build.errors(tables, counting)
    return Tabulated(values, model, medium.planar.B, measured, counting.photons)
