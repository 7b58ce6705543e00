"""How far a group `packing` is from a converged one."""

from collections.abc import Mapping

import numpy as np

from bakery.stages.packing.view import tiles
from bakery.store.tree import Group


def measures(group: Group, reference: Group) -> Mapping[str, float]:
    """Errors of a `packing` group against a converged one: of each measure the largest over the tiles.

    Returns
    -------
    dict of floats, in this order

    error : the largest of `fraction`, `mean_chord` and `second_moment`
    fraction : |reached - wished| over wished
    mean_chord : relative difference from the exact mean chord at the wished fraction
    second_moment : difference of <z^2>/(2<z>^2): the shape of the law of chords
    g2 : root mean square difference over shells of 0.4 mean radii, up to where both tiles reach
    """
    from bakery.physics.packing import theory

    errors = {"fraction": 0.0, "mean_chord": 0.0, "second_moment": 0.0, "g2": 0.0}
    for name, true in tiles(reference).items():
        baked = tiles(group)[name]
        wished = float(true["fraction_wished"].data[0])
        exact = float(theory.mean_chord(wished, baked["radii"].data))
        chords, converged = baked["chord_length"], true["chord_length"]
        for key, value in (
            ("fraction", abs(baked["fraction"].data[0] / wished - 1)),
            ("mean_chord", abs(chords["mean"].data[0] / exact - 1)),
            ("second_moment", abs(chords["second_moment"].data[0] - converged["second_moment"].data[0])),
            ("g2", _difference(baked, true)),
        ):
            errors[key] = max(errors[key], float(value))
    return {"error": max(errors["fraction"], errors["mean_chord"], errors["second_moment"])} | errors


def _difference(group: Group, reference: Group) -> float:
    if "pair_correlation" not in group.members or "pair_correlation" not in reference.members:
        return 0.0
    edges = [tile["pair_correlation/edges"].data for tile in (group, reference)]
    low, high = max(e[0] for e in edges), min(e[-1] for e in edges)
    common = np.arange(low, high + 1e-9, 0.4)
    if common.size < 2:
        return 0.0
    pairs = []
    for tile, e in zip((group, reference), edges):
        below = np.concatenate([[0], np.cumsum(tile["pair_correlation/g"].data * np.diff(e**3))])
        pairs.append(np.diff(np.interp(common**3, e**3, below)) / np.diff(common**3))
    return float(np.sqrt(np.mean((pairs[0] - pairs[1]) ** 2)))
