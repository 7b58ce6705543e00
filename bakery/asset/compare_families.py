"""Where two families differ: as the assets that they give at the points of both."""

import os
from dataclasses import replace

import numpy as np

import bakery
from bakery.asset import Family
from bakery.asset.compare import Difference, compare
from bakery.errors import AssetError, UsageError
from bakery.family.axes import points


def compare_any(a: str | os.PathLike, b: str | os.PathLike, rtol: float = 0.0) -> list[Difference]:
    """Where two assets, or two families, differ by more than `rtol`; empty if they hold the same.

    Families are compared at the points of both, as far as both reach there: of each dataset the worst place is told.

    Raises
    ------
    UsageError : one is a family, the other is not
    AssetError, StoreError : as `bakery.open`
    """
    opened_a, opened_b = bakery.open(a), bakery.open(b)
    families = [isinstance(side, Family) for side in (opened_a, opened_b)]
    if families == [False, False]:
        return compare(opened_a.tree, opened_b.tree, rtol)
    if not all(families):
        raise UsageError(f"{a if families[0] else b}: is a family, the other file is one asset; two of a kind are compared")
    return _axes(opened_a, opened_b, rtol) or _values(opened_a, opened_b, rtol)


def _axes(a: Family, b: Family, rtol: float) -> list[Difference]:
    """Other axes, which leave nothing to compare, and, without `rtol`, other points on them."""
    if [(name, axis.key, axis.values.units) for name, axis in a.axes.items()] != [
            (name, axis.key, axis.values.units) for name, axis in b.axes.items()]:
        return [Difference("family/axes", "missing", f"{', '.join(a.axes)} in A, {', '.join(b.axes)} in B")]
    return [Difference(f"family/axes/{name}", "grid", f"{len(axis.values)} points in A, {len(b.axes[name].values)} in B")
            for name, axis in a.axes.items() if not rtol and not np.array_equal(axis.values, b.axes[name].values)]


def _values(a: Family, b: Family, rtol: float) -> list[Difference]:
    indices, missing = {}, []
    nodes = []
    for name, axis in a.axes.items():
        in_a, in_b = np.asarray(axis.values), np.asarray(b.axes[name].values)
        union = np.union1d(in_a, in_b)
        nodes.append(union[(union >= max(in_a[0], in_b[0])) & (union <= min(in_a[-1], in_b[-1]))].tolist())
    if not all(nodes):
        return [Difference("family/axes", "missing", "they reach no place that both cover")]
    for point in points(nodes):
        at = dict(zip(a.axes, point, strict=True))
        words = ", ".join(f"{name} {value:.6g}" for name, value in at.items())
        sides = [_tree(family, at) for family in (a, b)]
        if None in sides:
            if sides != [None, None]:
                missing.append(Difference(f"family at {words}", "missing", f"only in {'B' if sides[0] is None else 'A'}"))
            continue
        for row in compare(*sides, rtol):
            worst = indices.get(row.path)
            if worst is None or (row.relative or 0.0) > (worst.relative or 0.0):
                indices[row.path] = replace(row, text=f"at {words}: {row.text}")
    return [*missing, *(row for path, row in indices.items() if path != "recipe")]


def _tree(family: Family, at: dict):
    """The asset of a place; None where a point failed."""
    try:
        return family.at(**at).tree
    except AssetError:
        return None
