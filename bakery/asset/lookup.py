"""One baked array at given arguments: the logic of `bake query`."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from bakery.asset.axes import axes, of_points
from bakery.errors import UsageError
from bakery.family.members import listed
from bakery.family.tree import error_of, is_family
from bakery.physics.medium.phase import phase_at
from bakery.stages.conform import FAMILY, stages_of
from bakery.stages.coordinates import COORDINATES, coordinate, stated_error
from bakery.stages.declaration import Answer, Remark
from bakery.store.tree import Dataset, Group

NAMED = 8  # points that failed, one by one
SAME = 1e-9  # relative distance below which an argument is a stored wavelength


def lookup(root: Group, path: str, arguments: Mapping[str, float | tuple[float, ...]]) -> Answer:
    """Values of the dataset at `path`, looked up at `arguments`.

    Parameters
    ----------
    arguments : `wavelength` in um (linear between the stored ones), `theta` in rad (linear in cos theta), `radius` in um (the
        nearest node: between two nodes no sphere was computed); a number or several

    Raises
    ------
    UsageError : an argument that has no effect on this dataset, or lies outside of what is stored
    """
    member = root[path]
    letters, points = axes(root, path), of_points(root, path)
    names = [COORDINATES.get(letter) for letter in letters]
    useless = [name for name in arguments if name not in names]
    if useless:
        given = [name for name in names if name]
        raise UsageError(f"{path}: {useless[0]} has no effect on it; " + (f"{' and '.join(given)} would" if given else
                         "it takes no arguments"))
    values, error = member.data, stated_error(root, path)
    axes_left, remarks = [], []
    axes_left += points
    if points and values.dtype.kind == "f" and (failed := [words for _, words, member in listed(root) if member.reason]):
        named = [*failed[:NAMED], *(["…"] if len(failed) > NAMED else [])]
        remarks.append(Remark(f"zeros stand for points that failed: {'; '.join(named)}"))
    if _unmeasured(root, path):
        remarks.append(Remark("zeros stand for intervals whose error is not known"))
    for letter, name in list(zip(letters, names, strict=True))[len(points):]:
        axis = len(axes_left)
        nodes_found = coordinate(root, path, letter)
        if name is None or nodes_found is None:
            axes_left.append(("index", "1", np.arange(values.shape[axis])))
            continue
        unit, nodes = nodes_found[1].units, nodes_found[1].data
        if name not in arguments:
            axes_left.append((name, unit, nodes))
            continue
        wanted = np.asarray(arguments[name], float)
        take, at, remark = _LOOKUPS[name](nodes, wanted, member)
        values, error = (_along(axis, data, take, wanted.ndim > 0) for data in (values, error))
        axes_left += [(name, unit, at)] if wanted.ndim else []
        remarks += [Remark(remark)] if remark else []
    if member.choices:
        values = np.array(member.choices)[values.astype(int)]
    if values.dtype.kind == "S":
        values = np.char.decode(values, "utf-8", "replace")
    for stage in stages_of(root):
        remarks += stage.remarks(root, path, letters, arguments)
    return Answer(path, member.units, np.asarray(values), tuple(axes_left), error, tuple(remarks))


def _unmeasured(root: Group, path: str) -> bool:
    """Whether a dataset holds zeros for errors of a family that are not known."""
    parent, _, name = path.rpartition("/")
    if not is_family(root) or not parent.startswith(f"{FAMILY}/axes/") or name != "error":
        return False
    return bool(np.isnan(error_of(root[parent])).any())


def _along(axis: int, data, take, several: bool):
    """`take`, which works on the last axis, on another one; several arguments leave the axis where it was, one removes it."""
    if data is None:
        return None
    taken = take(np.moveaxis(data, axis, -1))
    return np.moveaxis(taken, -1, axis) if several else taken


def _by_wavelength(nodes, wanted, member: Dataset):
    """Linear between the stored wavelengths; a stored one as it is."""
    order = np.argsort(nodes)
    ascending = nodes[order]
    # not: so that nan, which is neither below nor above, is outside as well
    if not ((wanted >= ascending[0] * (1 - SAME)) & (wanted <= ascending[-1] * (1 + SAME))).all():
        raise UsageError(f"wavelength: found {_numbers(wanted)} um; the asset holds {_numbers(nodes)} um"
                         + (" and what lies between" if nodes.size > 1 else ""))
    nearest = order[np.argmin(np.abs(ascending - wanted[..., None]), axis=-1)]
    if (np.abs(nodes[nearest] - wanted) <= SAME * nodes[nearest]).all():
        return lambda data: data[..., nearest], wanted, ""
    if member.data.dtype.kind != "f":
        raise UsageError(f"wavelength: found {_numbers(wanted)} um; between these values there are no others: "
                         f"take one of {_numbers(nodes)} um")
    upper = np.clip(np.searchsorted(ascending, wanted), 1, nodes.size - 1)
    low, high = order[upper - 1], order[upper]
    share = (wanted - nodes[low]) / (nodes[high] - nodes[low])
    pairs = sorted({(nodes[a], nodes[b]) for a, b in zip(np.atleast_1d(low), np.atleast_1d(high), strict=True)})
    remark = "linear between the wavelengths " + "; ".join(f"{a:g} and {b:g} um" for a, b in pairs)
    return lambda data: data[..., low] * (1 - share) + data[..., high] * share, wanted, remark


def _by_theta(nodes, wanted, member: Dataset):
    """Linear in cos theta, as the format says."""
    if not ((wanted >= 0) & (wanted <= np.pi)).all():
        raise UsageError(f"theta: found {_numbers(np.degrees(wanted))} deg; angles from 0 (forward) to 180 deg would do")
    stored = np.isin(wanted, nodes).all()
    return lambda data: phase_at(nodes, data, wanted), wanted, "" if stored else "linear in cos theta between the stored angles"


def _by_radius(nodes, wanted, member: Dataset):
    """The nearest node: spheres of other sizes were not computed."""
    if not ((wanted >= nodes.min() * (1 - SAME)) & (wanted <= nodes.max() * (1 + SAME))).all():
        raise UsageError(f"radius: found {_numbers(wanted)} um; the asset holds {nodes.min():g} to {nodes.max():g} um")
    nearest = np.argmin(np.abs(nodes - wanted[..., None]), axis=-1)
    exact = (np.abs(nodes[nearest] - wanted) <= SAME * nodes[nearest]).all()
    remark = "" if exact else f"at the nearest node of the size distribution, {_numbers(nodes[nearest], 8)} um"
    return lambda data: data[..., nearest], nodes[nearest], remark


_LOOKUPS = {"wavelength": _by_wavelength, "theta": _by_theta, "radius": _by_radius}


def _numbers(values, digits: int = 6) -> str:
    return ", ".join(f"{x:.{digits}g}" for x in np.atleast_1d(values))
