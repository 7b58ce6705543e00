"""Tables of the kernels of one medium: transport where the phase function can be resolved, the small-angle model otherwise."""

from dataclasses import dataclass

import numpy as np

from bakery.physics.beam import photons, planar, single, small_angle, table, transport
from bakery.physics.medium import phase as tables
from bakery.physics.multiple import legendre

LARGEST = 2048  # Legendre orders that transport takes
# Moments below are nothing (cut at 1e-5 they leave ripples of 1e-6 behind the beam); the second where there are very many.
_CUT, _COARSE = 1e-6, 1e-5


@dataclass(frozen=True)
class Medium:
    """A phase function prepared for both models."""

    planar: planar.Planar  # for the small-angle model
    line: single.Line  # for single scattering
    moments: np.ndarray | None  # (L + 1,) Legendre moments, or None where more than `LARGEST` would be needed
    g: float  # mean cosine


def prepare(theta, phase) -> Medium:
    """A phase table, (A,) rad and (A,) 1/sr, linear in cos theta and normalised, as the kernels need it."""
    theta, phase = np.asarray(theta, float), np.asarray(phase, float)
    for order, cut in ((64, _CUT), (512, _CUT), (LARGEST, _COARSE)):
        p = legendre.moments(theta, phase, order)
        last = legendre.order_needed(p, cut)
        if last is not None:
            break
    moments = None if last is None else p[:max(last, 6) + 1]
    return Medium(planar.table(theta, phase), single.line(theta, phase), moments, float(tables.mean_cosine(theta, phase)))


def model_of(medium: Medium) -> str:
    """The best model that can be had."""
    return "transport" if medium.moments is not None else "small-angle"


def small_angle_table(medium: Medium, albedo, depth, nodes=None) -> table.Table:
    """The small-angle kernel; arguments as in `transport_tables`.  It knows forward light only: one table for all measures."""
    z, ratio = nodes or table.grid(depth, medium.planar.width)
    return _table(z, ratio, small_angle.homogeneous(medium.planar, albedo, z, ratio))


def transport_tables(medium: Medium, albedo, depth, nodes=None) -> dict[str, table.Table]:
    """Tables of all `kinds.MEASURES` by transport.

    medium : of `prepare`
    nodes : (depth, ratio) of `table.grid`, for several wavelengths that of the narrowest; None: those of this medium

    Raises ValueError : the phase function is too narrow for transport
    """
    if medium.moments is None:
        raise ValueError(f"the phase function needs more than {LARGEST} Legendre orders; the small-angle model takes it")
    z, ratio = nodes or table.grid(depth, medium.planar.width)
    forward, back = _transported(medium, albedo, z[:, None], z[:, None] * ratio)
    return {"fluence": _table(z, ratio, forward[0] + back[0]), "forward": _table(z, ratio, forward[0]),
            "flux": _table(z, ratio, forward[1])}


def errors(tables, counting):
    """Root mean square errors of tables against photons (`photons.rms`).

    tables : measure -> Table, measures as in `kinds.MEASURES`
    counting : `photons.Counting`, of the medium, in planes and rings within the tables

    Returns measure -> (error, noise of the photons), both relative
    """
    result = {}
    for back in (False, True):
        names = [name for name in tables if (name == "fluence") == back]
        if names:
            counted = counting.counted(back)
            for name in names:
                rings = tables[name].rings(counted.depth, counted.edges)
                result[name] = photons.rms(rings, counted, "flux" if name == "flux" else "fluence")
    return result


def _transported(medium, albedo, depth, r):
    forward, back = single.single(albedo, medium.line, depth, r)
    if albedo > 0:
        at = transport.point(albedo, medium.moments, medium.planar.width)
        ahead, behind = transport.split(*transport.half_space(at, 1 / (1 - albedo * medium.g), depth, r))
        forward, back = forward + ahead, back + behind
    return forward, back


def _table(depth, ratio, kernel):
    return table.Table(depth, ratio, np.maximum(kernel, 0.0) * depth[:, None] ** 2 * ratio)
