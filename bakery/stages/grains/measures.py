"""How far a group `grains` is from a converged one."""

from collections.abc import Mapping

import numpy as np

from bakery.stages.grains.outputs import ASKED
from bakery.stages.measures import integrated_difference
from bakery.store.tree import Dataset, Group


def measures(group: Group, reference: Group) -> Mapping[str, float]:
    """Errors of a `grains` group against a converged one: of each measure the largest over components, radii and wavelengths.

    Returns
    -------
    dict of floats, in this order

    error : the largest of the others, half of `phase`
    hit_probability, albedo : relative (of an albedo of at least 0.01)
    phase : integral of |f - f_ref| over the sphere
    lambda_delta, lambda_s, mean_square, g, forward_delta : differences, in radii of the bounding sphere
    """
    errors = dict.fromkeys((*ASKED, "forward_delta"), 0.0)
    theta = np.asarray(reference["theta"].data, float)
    for name, true in reference.members.items():
        if not isinstance(true, Group):
            continue
        for key in errors:
            pairs = [(group[f"{name}/{path}"].data, member.data) for path, member in true.walk()
                     if isinstance(member, Dataset) and path.rpartition("/")[2] == key]
            for baked, converged in pairs:
                if key == "phase":
                    error = integrated_difference(theta, baked, converged)
                else:
                    scale = {"hit_probability": converged, "albedo": np.maximum(converged, 0.01)}.get(key, 1.0)
                    error = np.abs(baked - converged) / scale
                errors[key] = max(errors[key], float(np.max(error)))
    return {"error": max(0.5 * value if key == "phase" else value for key, value in errors.items())} | errors
