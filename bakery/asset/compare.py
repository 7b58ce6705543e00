"""Where two assets differ: the logic of `bake diff`.

What counts is what a user of the asset gets: which groups and datasets there are, their shapes, types, units and values, and the
error that each stage states.  How the values came about does not count: provenance, hashes, versions, descriptions, the name.
The recipe's text is reported only beside a difference that counts: two recipes that differ in a comment bake the same asset.

Tables over different angles are compared at the angles of both, as the format reads them: linear in cos theta.  Figures of
spheres at different nodes of a size distribution are compared at the radii that both have: no others were computed.
"""

import math
import os
from dataclasses import dataclass, replace

import numpy as np

from bakery.asset import read_checked
from bakery.store.tree import Dataset, Group, is_text

_COUNTING_ATTRIBUTES = ("tolerance", "achieved_error", "error_measure")


@dataclass(frozen=True)
class Difference:
    """One place where two assets differ."""

    path: str  # of the dataset or group; an attribute is written `medium@tolerance`
    kind: str  # missing, shape, grid, type, units, attribute, value, recipe
    text: str  # what is there in A and in B, or the worst of many values
    # absolute, relative: largest difference of a value, in its unit and relative to its scale (None unless kind is `value`)
    absolute: float | None = None
    relative: float | None = None
    sigmas: float | None = None  # largest difference in standard errors, where both assets have `X_error`

    def __str__(self) -> str:
        return f"{self.path}: {self.kind}: {self.text}"


def compare(a: str | os.PathLike | Group, b: str | os.PathLike | Group, rtol: float = 0.0) -> list[Difference]:
    """Where two assets differ by more than `rtol`; empty if they hold the same.

    a, b : paths, or trees that were read before
    rtol : largest relative difference of a float that is let pass; 0 asks for equal numbers.  A number is compared relative to
        the larger of the two, or, in a dataset that holds both signs and so crosses zero, to the largest magnitude along its
        last axis.  With `rtol` 0 other angles are a difference, else only values at them are.

    Raises AssetError, StoreError : as `bakery.open`
    """
    a, b = (side if isinstance(side, Group) else read_checked(side) for side in (a, b))
    differences = _attributes("", a, b, rtol)
    datasets_a, datasets_b = (dict(side.walk()) for side in (a, b))
    moved, sized = (_differs(name, datasets_a, datasets_b) for name in ("theta", "radius"))
    for path in [*datasets_a, *(path for path in datasets_b if path not in datasets_a)]:
        if path.split("/")[0] in ("provenance", "recipe"):
            continue
        in_a, in_b = datasets_a.get(path), datasets_b.get(path)
        if in_a is None or in_b is None:
            parent = path.rpartition("/")[0]
            if not parent or (parent in datasets_a and parent in datasets_b):  # not again for all that a missing group holds
                differences.append(Difference(path, "missing", f"only in {'B' if in_a is None else 'A'}"))
        elif isinstance(in_a, Group) or isinstance(in_b, Group):
            if isinstance(in_a, Group) and isinstance(in_b, Group):
                differences += _attributes(path, in_a, in_b, rtol)
            else:
                differences.append(Difference(path, "type", "a group in one, a dataset in the other"))
        elif sized and (nodes := _nodes(path, a, b)) is not None:
            differences += _on_nodes(path, in_a, in_b, nodes, rtol)
        elif moved and (angles := _angles(path, a, b)) is not None:
            differences += _on_angles(path, a, b, angles, rtol)
        else:
            differences += _datasets(path, in_a, in_b, _errors(path, datasets_a, datasets_b), rtol)
    in_a, in_b = a.members.get("recipe"), b.members.get("recipe")
    if differences and isinstance(in_a, Dataset) and isinstance(in_b, Dataset) and not np.array_equal(in_a.data, in_b.data):
        differences.append(Difference("recipe", "recipe", "the recipes' texts differ"))
    return differences


def _differs(name: str, members_a: dict, members_b: dict) -> bool:
    """Whether any coordinate of a name is another in B."""
    return any(path.rpartition("/")[2] == name and isinstance(member, Dataset) and isinstance(members_b.get(path), Dataset)
               and not np.array_equal(member.data, members_b[path].data) for path, member in members_a.items())


def _attributes(path: str, a: Group, b: Group, rtol: float) -> list[Difference]:
    differences = []
    for name in _COUNTING_ATTRIBUTES:
        in_a, in_b = a.attributes.get(name), b.attributes.get(name)
        both_numbers = isinstance(in_a, float) and isinstance(in_b, float)
        same = in_a == in_b or (both_numbers and abs(in_a - in_b) <= rtol * max(abs(in_a), abs(in_b)))
        if not same:
            differences.append(Difference(f"{path}@{name}", "attribute", f"{in_a!r} in A, {in_b!r} in B"))
    return differences


def _errors(path: str, datasets_a: dict, datasets_b: dict) -> np.ndarray | None:
    """Standard error of the difference, where both sides state theirs."""
    in_a, in_b = datasets_a.get(f"{path}_error"), datasets_b.get(f"{path}_error")
    if isinstance(in_a, Dataset) and isinstance(in_b, Dataset) and in_a.data.shape == in_b.data.shape:
        return np.hypot(in_a.data, in_b.data)
    return None


def _angles(path: str, a: Group, b: Group) -> np.ndarray | None:
    """The angles of both sides' grids, rad, where a dataset is over angles and the two grids differ."""
    in_a, in_b = _grid(path, a), _grid(path, b)
    if in_a is None or in_b is None or np.array_equal(in_a, in_b):
        return None
    if a[path].data.shape[:-1] != b[path].data.shape[:-1] or a[path].data.dtype != b[path].data.dtype:
        return None
    return np.union1d(in_a, in_b)


def _grid(path: str, root: Group) -> np.ndarray | None:
    """The angles of a dataset's last axis, if it has that axis and they are ascending from 0 to pi."""
    from bakery.asset.axes import axes
    from bakery.stages.coordinates import coordinate

    if root[path].data.ndim == 0 or axes(root, path)[-1:] != ("A",):
        return None
    theta = coordinate(root, path, "A")[1].data
    sound = theta.dtype.kind == "f" and theta.size > 1 and theta[0] == 0 and theta[-1] == math.pi and (np.diff(theta) > 0).all()
    return theta if sound else None


def _nodes(path: str, a: Group, b: Group) -> tuple[np.ndarray, np.ndarray] | None:
    """Positions in A and in B of the radii that both have, where the last axis of a dataset is over radii and these differ."""
    from bakery.asset.axes import axes
    from bakery.stages.coordinates import coordinate

    if any(side[path].data.ndim == 0 or axes(side, path)[-1:] != ("R",) for side in (a, b)):
        return None
    radii = [coordinate(side, path, "R")[1].data for side in (a, b)]
    if np.array_equal(*radii) or a[path].data.shape[:-1] != b[path].data.shape[:-1]:
        return None
    return np.intersect1d(*radii, return_indices=True)[1:]


def _on_nodes(path: str, a: Dataset, b: Dataset, nodes, rtol: float) -> list[Difference]:
    """Where figures of spheres differ at `nodes`, those of both; of the nodes themselves and their weights, that they differ."""
    if a.data.ndim == 1:
        counts = f"{a.data.size} nodes in A, {b.data.size} in B; tables are compared at the {nodes[0].size} that both have"
        return [] if rtol or path.rpartition("/")[2] != "radius" else [Difference(path, "grid", counts)]
    if not nodes[0].size:
        return []
    a, b = (replace(side, data=side.data[..., where]) for side, where in zip((a, b), nodes, strict=True))
    return _datasets(path, a, b, None, rtol)


def _on_angles(path: str, a: Group, b: Group, angles: np.ndarray, rtol: float) -> list[Difference]:
    """Where two tables differ at any of the angles; of the grids themselves, that they differ."""
    from bakery.stages.coordinates import standard_error

    if path.rpartition("/")[2] == "theta":
        counts = f"{a[path].data.size} angles in A, {b[path].data.size} in B; tables are compared at {angles.size}"
        return [] if rtol else [Difference(path, "grid", counts)]
    in_a, in_b = (_at(path, side, angles) for side in (a, b))
    stated = f"{path}_error"
    errors = ({stated: _at(stated, side, angles)} if standard_error(side, path) is not None else {} for side in (a, b))
    return _datasets(path, in_a, in_b, _errors(path, *errors), rtol, angles)


def _at(path: str, root: Group, angles: np.ndarray) -> Dataset:
    """A table at other angles."""
    from bakery.physics.medium.phase import cumulative, phase_at

    member, theta = root[path], _grid(path, root)
    parent, _, name = path.rpartition("/")
    phase = root[parent].members.get("phase") if parent else None
    if name == "cdf" and isinstance(phase, Dataset) and phase.data.shape == member.data.shape:
        return replace(member, data=cumulative(angles, phase_at(theta, phase.data, angles)))  # not linear: of the phase function
    return replace(member, data=phase_at(theta, member.data, angles))


def _datasets(path: str, a: Dataset, b: Dataset, error: np.ndarray | None, rtol: float,
              angles: np.ndarray | None = None) -> list[Difference]:
    for kind, in_a, in_b in (("shape", a.data.shape, b.data.shape), ("type", a.data.dtype.str, b.data.dtype.str),
                             ("type", a.choices, b.choices), ("units", a.units, b.units)):
        if in_a != in_b:
            return [Difference(path, kind, f"{in_a} in A, {in_b} in B")]
    if np.array_equal(a.data, b.data):
        return []
    if a.data.dtype.kind not in "fc":
        count = np.count_nonzero(a.data != b.data)
        counted = "texts" if is_text(a) else f"{count} of {a.data.size} values"
        return [Difference(path, "value", f"{counted} differ")]
    return _values(path, a, b, error, rtol, angles)


def _values(path: str, a: Dataset, b: Dataset, error: np.ndarray | None, rtol: float,
            angles: np.ndarray | None) -> list[Difference]:
    in_a, in_b = a.data, b.data
    with np.errstate(all="ignore"):
        # infinities and not-a-numbers agree with themselves and with nothing else
        same = (in_a == in_b) | (np.isnan(in_a) & np.isnan(in_b))
        gap = np.where(same, 0.0, np.abs(in_a - in_b))
        gap = np.where(np.isnan(gap), math.inf, gap)
        larger = np.maximum(np.abs(in_a), np.abs(in_b))
        if in_a.dtype.kind == "f" and (min(in_a.min(), in_b.min()) < 0 < max(in_a.max(), in_b.max())):
            larger = np.broadcast_to(larger.max(axis=-1, keepdims=True), larger.shape)
        relative = np.where(gap > 0, np.where(np.isfinite(larger), gap / larger, math.inf), 0.0)
        worst = np.unravel_index(np.argmax(relative), relative.shape)
        sigmas = None
        if error is not None and error.shape == gap.shape:
            sigmas = float(np.max(np.where(gap > 0, gap / error, 0.0)))
    if not relative[worst] > rtol:
        return []
    where = list(map(int, worst)) if angles is None else f"{math.degrees(angles[worst[-1]]):.6g} deg"
    text = (f"{in_a[worst]:.10g} in A, {in_b[worst]:.10g} in B at {where}: {relative[worst]:.3g} relative, "
            f"up to {gap.max():.3g}{'' if a.units == '1' else ' ' + a.units}, {np.count_nonzero(relative > rtol)} of {gap.size}")
    if sigmas is not None:
        text += f"; up to {sigmas:.2g} standard errors"
    return [Difference(path, "value", text, float(gap.max()), float(relative[worst]), sigmas)]
