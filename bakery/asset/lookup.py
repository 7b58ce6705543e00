"""One baked array at given arguments: the logic of `bake query`."""

from collections.abc import Mapping

import numpy as np

from bakery.asset.axes import axes, of_points
from bakery.errors import UsageError
from bakery.family.members import listed
from bakery.family.tree import error_of, is_family
from bakery.physics.medium.phase import phase_at
from bakery.physics.medium.spectral import SAME, interpolated, places
from bakery.stages.conform import FAMILY, stages_of
from bakery.stages.coordinates import COORDINATES, coordinate, stated_error, wavelengths
from bakery.stages.declaration import Answer, Remark
from bakery.stages.medium.between import at_wavelengths, can
from bakery.store.tree import Dataset, Group

NAMED = 8  # points that failed, one by one


def lookup(root: Group, path: str, arguments: Mapping[str, float | tuple[float, ...]]) -> Answer:
    """Values of the dataset at `path`, looked up at `arguments`.

    arguments : `wavelength` in um (a power of it between the stored ones), `theta` in rad (linear in cos theta), `radius` in um
        (the nearest node: between two nodes no sphere was computed); a number or several

    Raises UsageError : an argument that has no effect on this dataset, or lies outside of what is stored
    """
    asked, (root, remarks) = root, _between(root, path, arguments)
    member = root[path]
    letters, points = axes(root, path), of_points(root, path)
    names = [COORDINATES.get(letter) for letter in letters]
    useless = [name for name in arguments if name not in names]
    if useless:
        given = [name for name in names if name]
        raise UsageError(f"{path}: {useless[0]} has no effect on it; " + (f"{' and '.join(given)} would" if given else
                         "it takes no arguments"))
    values, error = member.data, stated_error(root, path)
    axes_left = list(points)
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
        remarks += stage.remarks(asked, path, letters, arguments)
    return Answer(path, member.units, np.asarray(values), tuple(axes_left), error, tuple(remarks))


def _between(root: Group, path: str, arguments: Mapping) -> tuple[Group, list[Remark]]:
    """The tree with the medium at the wavelengths that are asked for, where the path leads into it, and what that is in words."""
    medium, stored = root.members.get("medium"), root.members.get("wavelength")
    if not path.startswith("medium/") or "wavelength" not in arguments or not can(medium) or "L" not in axes(root, path):
        return root, []
    um = np.atleast_1d(wavelengths(arguments["wavelength"], stored.data))
    around = places(stored.data, um)
    if not (around.power > 0).any():
        return root, []
    told = _told(stored.data, around) + ("; what that is off by is not known of two wavelengths" if stored.data.size == 2 else
                                         "; the error is with what leaving out neighbours shows that to be off by")
    members = {"medium": at_wavelengths(medium, stored.data, um), "wavelength": Dataset(um, "um", stored.description)}
    return Group(root.members | members, root.attributes), [Remark(told)]


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
    """As a power of the wavelength between the stored ones (`physics.medium.spectral`); a stored one as it is."""
    um = np.atleast_1d(wavelengths(wanted, nodes))
    around = places(nodes, um)
    between = around.power > 0
    if between.any() and member.data.dtype.kind != "f":
        raise UsageError(f"wavelength: found {_numbers(wanted)} um; between these values there are no others: "
                         f"take one of {_numbers(nodes)} um")

    def take(data):
        if not between.any():
            return data[..., around.lower if wanted.ndim else around.lower[0]]
        taken = np.moveaxis(interpolated(around, np.moveaxis(data, -1, 0)), 0, -1)
        return taken if wanted.ndim else taken[..., 0]

    return take, wanted, _told(nodes, around) if between.any() else ""


def _told(nodes, around) -> str:
    """Between which wavelengths is interpolated, in words."""
    pairs = sorted({tuple(sorted((nodes[a], nodes[b]))) for a, b in zip(around.lower, around.upper, strict=True) if a != b})
    return "as a power of the wavelength between " + "; ".join(f"{a:g} and {b:g} um" for a, b in pairs)


def _by_theta(nodes, wanted, member: Dataset):
    """Linear in cos theta, as the format says."""
    if not ((wanted >= 0) & (wanted <= np.pi)).all():
        raise UsageError(f"theta: found {_numbers(np.degrees(wanted))} deg; expected angles from 0 (forward) to 180 deg")
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
