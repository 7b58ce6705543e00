"""What holds in every group `packing`: what readers count on, and what `verify` asks besides."""

from collections.abc import Iterable, Mapping

import numpy as np

from bakery.stages.packing.outputs import REQUIRED
from bakery.stages.packing.view import tiles
from bakery.store.tree import Dataset, Group

LEAST_GAP = -1e-9  # of the mean diameter: less is rounding, more an overlap


def sound(group: Group) -> Iterable[str]:
    """Whether each tile is complete, its spheres have room in it, and its bins ascend."""
    by_name = tiles(group)
    if not by_name:
        yield "holds no tile"
    for name, tile in by_name.items():
        v = {path: member.data for path, member in tile.walk() if isinstance(member, Dataset)}
        missing = [path for path in REQUIRED if path not in v]
        faults = [f"{', '.join(missing)} missing"] if missing else [*_room(v["centers"], v["radii"], v["cell"]), *_bins(v)]
        yield from (f"{name}: {fault}" if name else fault for fault in faults)


def _room(centers, radii, cell) -> Iterable[str]:
    """Whether spheres (N, 3), (N,) can lie in a cell (3,) at all.

    What searches for neighbours takes time and memory by the number of spheres in reach; this holds it down without a search.
    """
    if not radii.size or not (radii > 0).all() or not (cell > 0).all():
        yield "radii and cell are not above 0"
    elif abs(radii.mean() - 1) > 1e-12:
        yield f"the mean radius is {radii.mean():.15g}, not the unit 1"
    elif cell.min() < 2 * radii.max() * (1 + 2 * LEAST_GAP):
        yield "a sphere that overlaps its own images: cell is smaller than its diameter"
    elif (centers < 0).any() or (centers >= cell).any():
        yield "a centre outside of the cell"
    elif 4 / 3 * np.pi * np.sum(radii**3) > np.prod(cell) * (1 + 1e-9):
        yield "centers, radii: more spheres than the cell has room for"
    else:
        kind = np.floor(np.log2(radii / radii.min())).astype(int)
        for of in np.unique(kind):
            ours = kind == of
            # two centres in a cube are at most its diagonal apart, here just below the distance of two of these spheres
            cube = (2 * radii[ours].min() - 4e-9) / np.sqrt(3)
            _, number = np.unique(np.floor(centers[ours] / cube), axis=0, return_counts=True)
            if number.max() > 1:
                yield f"centers: two spheres overlap, {number.max()} centres lie where one has room"
                return


def _bins(v: Mapping[str, np.ndarray]) -> Iterable[str]:
    edges = v["chord_length/edges"]
    if edges[0] != 0 or not (np.diff(edges) > 0).all():
        yield "chord_length: edges do not ascend from 0, one more than density has bins"
    if "pair_correlation/g" in v and not (np.diff(v["pair_correlation/edges"]) > 0).all():
        yield "pair_correlation: edges do not ascend, one more than g has bins"


def check(group: Group) -> Iterable[str]:
    """Broken rules of a `packing` group, in words."""
    for name, tile in tiles(group).items():
        yield from (f"{name}: {fault}" if name else fault for fault in _check_tile(tile))


def _check_tile(tile: Group) -> Iterable[str]:
    from bakery.physics.packing import structure, theory

    v = {path: np.asarray(member.data, float) for path, member in tile.walk() if isinstance(member, Dataset)}
    centers, radii, cell = v["centers"], v["radii"], v["cell"]
    gap = structure.smallest_gap(centers, radii, cell)
    if not gap >= LEAST_GAP:
        yield f"two spheres overlap by {-gap:.2g} mean diameters"
    if abs(gap - v["smallest_gap"][0]) > 1e-12 * max(1, abs(gap)):
        yield f"smallest_gap is not that of the spheres, {gap:.6g}"
    filled = structure.fraction(radii, cell)
    if abs(v["fraction"][0] / filled - 1) > 1e-12:
        yield f"fraction is not the volume of the spheres over that of the cell, {filled:.15g}"
    if "pair_correlation/g" in v \
            and v["pair_correlation/g"][v["pair_correlation/edges"][1:] < 2 * radii.min() * (1 + LEAST_GAP)].any():
        yield "pair_correlation: pairs closer than the two smallest spheres"
    total = float(np.sum(v["chord_length/density"] * np.diff(v["chord_length/edges"])))
    if abs(total - 1) > 1e-12:
        yield f"chord_length: density integrates to {total:.15g}, not 1"
    exact = float(theory.mean_chord(filled, radii))
    if abs(v["chord_length/mean_exact"][0] / exact - 1) > 1e-12:
        yield f"chord_length: mean_exact is not 4 V/S = {exact:.15g}"
    # six standard errors: a false alarm in 5e8 tiles; a chord cut off makes the mean too small by an unknown amount
    if v["chord_length/cut"][0] == 0 and abs(v["chord_length/mean"][0] - exact) > 6 * v["chord_length/mean_error"][0]:
        yield f"chord_length: mean is more than six standard errors away from 4 V/S = {exact:.6g}"
