"""Red, green and blue light that an asset's wavelengths do not reach."""

from collections.abc import Mapping

import numpy as np


def beyond(um, bands: Mapping[str, tuple[float, float]]) -> list[str]:
    """What is to be said first of bands that lie wholly beyond an asset's wavelengths: they have the values at its first or last.

    um : (L,) um, the asset's, in any order; a single one stands for grey, and there is nothing to be said
    bands : name -> (low, high) um, the lower end belongs to it
    """
    first, last = float(np.min(um)), float(np.max(um))
    if first == last:
        return []
    remarks = []
    for end, names in ((first, [name for name, (_, high) in bands.items() if high <= first]),
                       (last, [name for name, (low, _) in bands.items() if low > last])):
        if names:
            edges = [edge for name in names for edge in bands[name]]
            listed = " and ".join(filter(None, (", ".join(names[:-1]), names[-1])))
            lie, have = ("lies", "has") if len(names) == 1 else ("lie", "have")
            remarks.append(f"{listed} ({min(edges):g} to {max(edges):g} um) {lie} beyond the asset's wavelengths, "
                        f"{first:g} to {last:g} um, and {have} the values at {end:g} um")
    return remarks
