"""What varies in a body of grains: its packing fraction and its mixture, by the grids of a scene."""

from typing import NamedTuple

import numpy as np

from bakery import kernels
from renderers.scene import grids

_SLACK = 1e-6  # relative: float32 files, rounded corners


class Local(NamedTuple):
    """Fields in m, None where nothing varies.

    share : of the tile's spheres that is there, 0 to 1
    mixture : cumulated shares of the components, in the asset's order
    """

    share: kernels.Field | None
    mixture: kernels.Field | None


UNIFORM = Local(None, None)


def local_of(scene, body, asset, fraction, vertices) -> Local:
    """What varies in a body, by its number.

    fraction : of the tile that it is filled with;  vertices : (V, 3) m, of its mesh

    Raises UsageError with the key where a grid is not what it should be.
    """
    says, key = scene.values.materials[body], f"materials[{body}]"
    return Local(says.fraction and _share(scene, f"{key}.fraction", says.fraction, fraction, vertices),
                 says.mixture and _mixture(scene, f"{key}.mixture", says.mixture, asset, vertices))


def check(scene, body, vertices) -> None:
    """UsageError with the key where a grid of a body, by its number, does not hold its mesh, vertices (V, 3) m."""
    says, key = scene.values.materials[body], f"materials[{body}]"
    if says.fraction:
        _read(scene, f"{key}.fraction", says.fraction, vertices)
    for name, grid in (says.mixture or {}).items():
        _read(scene, f"{key}.mixture.{name}", grid, vertices)


def _read(scene, key, where, vertices):
    """Values and box of a grid that holds a mesh."""
    values, lo, hi = grids.placed(scene, key, where)
    lowest, highest = vertices.min(axis=0), vertices.max(axis=0)
    slack = _SLACK * (highest - lowest).max()
    if np.any(lowest < lo - slack) or np.any(highest > hi + slack):
        raise scene.wrong(f"{key}.grid", f"found a box from {_point(lo)} to {_point(hi)} m, but the mesh reaches from "
                          f"{_point(lowest)} to {_point(highest)} m; a box that holds it would do")
    return values, lo, hi


def _share(scene, key, where, fraction, vertices):
    values, lo, hi = _read(scene, key, where, vertices)
    most = float(values.max())
    if most > fraction * (1 + _SLACK):
        voxel = np.argwhere(values == values.max())[0]
        at = lo + (voxel + 0.5) * (hi - lo) / values.shape
        raise scene.wrong(f"{key}.grid", f"found the fraction {most:.6g} at [{', '.join(map(str, voxel))}], {_point(at)} m; at "
                          f"most {fraction:.6g}, that of the asset's tile, would do, or an asset with a larger packing.fraction")
    share = np.asarray(values, float) / fraction
    share[share > 1 - _SLACK] = 1.0
    return None if share.min() == 1.0 else kernels.field(lo, hi, share)


def _mixture(scene, key, where, asset, vertices):
    names = list(asset.grains.exemplars)
    if unknown := [name for name in where if name not in names]:
        raise scene.wrong(f"{key}.{unknown[0]}", f"the asset has no such component; {', '.join(names)} would do")
    given, (first, *_) = {}, where
    for name, grid in where.items():
        given[name], *box = _read(scene, f"{key}.{name}", grid, vertices)
        if name == first:
            lo, hi = box
        elif given[name].shape != given[first].shape or not np.allclose(box, (lo, hi), rtol=0, atol=_SLACK * (hi - lo).max()):
            raise scene.wrong(f"{key}.{name}.grid", f"found {_grid(given[name], *box)}, but {first} has "
                              f"{_grid(given[first], lo, hi)}; the same would do")
    weights = {name: float(asset.grains[name].weight[0]) for name in names if name not in given}
    total = sum(np.asarray(grid, float) for grid in given.values())
    if not sum(weights.values()) > 0 and not total.all():
        voxel = np.argwhere(total == 0)[0]
        raise scene.wrong(key, f"found shares of 0 of all components at [{', '.join(map(str, voxel))}]; one above 0 would do")
    # what the grids leave belongs to the components that have none, by their weights
    remaining = np.maximum(1 - total, 0) / sum(weights.values()) if sum(weights.values()) > 0 else 0.0
    shares = np.stack([given[name] if name in given else weights[name] * remaining for name in names], axis=-1)
    cumulated = np.cumsum(shares, axis=-1)
    return kernels.field(lo, hi, cumulated / cumulated[..., -1:])


def _point(position):
    return "[" + ", ".join(f"{x:.4g}" for x in position) + "]"


def _grid(values, lo, hi):
    return f"{' x '.join(map(str, values.shape))} values from {_point(lo)} to {_point(hi)} m"
