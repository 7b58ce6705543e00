"""True errors of a stage's values: how far they are from values that have converged."""

from collections.abc import Mapping

import numpy as np

from bakery.physics.medium import phase
from bakery.store.tree import Group

_LEAST = 1e-6  # of the mean phase function 1/(4 pi): below that a relative error is of no consequence


def optics(baked: Group, reference: Group) -> Mapping[str, float]:
    """Errors of an `optics` group against a converged one: of each measure the largest over components and wavelengths.

    Parameters
    ----------
    baked, reference : groups of the same recipe, whose angles need not be the same

    Returns
    -------
    dict of floats, in this order

    error : the largest of `phase`, `extinction` and the change of the mean absorption relative to the mean *extinction*: what a
        tolerance is held against
    phase : integral of |f - f_ref| over the sphere; half of it is the share of the light that goes to another angle
    phase_pointwise : largest |f - f_ref| / f_ref at any angle (f_ref at least 1e-6 of its mean over the sphere)
    extinction : relative change of the mean extinction
    absorption : relative change of the mean absorption; 0 where neither absorbs
    g : change of the mean cosine

    Notes
    -----
    Both tables are taken onto the union of their angles, linear in cos theta in between as the asset defines them, so that
    nothing is lost: the integral is exact, and the largest ratio of two lines lies at an end.
    """
    theta, reference_theta = (np.asarray(group["theta"].data, float) for group in (baked, reference))
    at = np.union1d(theta, reference_theta)
    errors = {"phase": 0.0, "phase_pointwise": 0.0, "extinction": 0.0, "absorption": 0.0, "g": 0.0}
    lost = 0.0
    for name, true in reference.members.items():
        if not isinstance(true, Group):
            continue
        measured = baked[name]
        table, true_table = np.asarray(measured["phase"].data, float), np.asarray(true["phase"].data, float)
        f, f_ref = phase.phase_at(theta, table, at), phase.phase_at(reference_theta, true_table, at)
        floor = np.maximum(f_ref, _LEAST / (4 * np.pi))
        extinction, true_extinction = (np.asarray(group["mean_extinction"].data, float) for group in (measured, true))
        absorption, true_absorption = (np.asarray(group["mean_absorption"].data, float) for group in (measured, true))
        change = np.abs(absorption - true_absorption)
        g, true_g = phase.mean_cosine(theta, table), phase.mean_cosine(reference_theta, true_table)
        lost = max(lost, float(np.max(change / true_extinction)))
        for key, values in (
            ("phase", integrated_difference(at, f, f_ref)),
            ("phase_pointwise", np.abs(f - f_ref) / floor),
            ("extinction", np.abs(extinction - true_extinction) / true_extinction),
            # an absorption that should be 0 counts relative to the extinction
            ("absorption", change / np.where(true_absorption > 0, true_absorption, true_extinction)),
            ("g", np.abs(g - true_g)),
        ):
            errors[key] = max(errors[key], float(np.max(values)))
    return {"error": max(errors["phase"], errors["extinction"], lost)} | errors


def integrated_difference(theta, f, reference):
    """Integral of |f - other| over the sphere, (...,); f, other (..., A) 1/sr at theta (A,), linear in cos theta in between."""
    d = np.asarray(f, float) - np.asarray(reference, float)
    a, b = np.abs(d[..., :-1]), np.abs(d[..., 1:])
    # where the sign changes within a cell the two triangles count, not their difference
    crossing = np.divide(a * a + b * b, a + b, out=np.zeros_like(a), where=a + b > 0)
    cells = np.where(d[..., :-1] * d[..., 1:] < 0, crossing, a + b)
    return np.pi * np.sum(cells * phase.steps(theta), axis=-1)
