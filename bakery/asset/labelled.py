"""Assets as xarray's labelled arrays, and back: names, units, errors, coordinates by the Climate and Forecast conventions.

`long_name` is the description, `units` as stored (UDUNITS reads them), `flag_meanings` the names of an enumeration,
`ancillary_variables` the arrays `X_error` and `X_bias` of X, `largest_error` the largest of both together.  CF has names for
wavelengths and scattering angles, which are `standard_name`; those for coefficients are of aerosol in air or of sea water alone.
xarray is imported where it is asked for.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from bakery.asset.axes import axes, declared_letters, of_points
from bakery.errors import UsageError
from bakery.stages.conform import FAMILY
from bakery.stages.coordinates import BIAS, COORDINATES, ERROR, coordinate, stated_error
from bakery.store.tree import Dataset, Group, is_text, read_text, text

if TYPE_CHECKING:
    import xarray

INSTALL = 'pip install ".[xarray]" in the folder of bakery\'s sources'
STORED = "bakery_path"  # attribute of a variable: where it stands in the asset
_AXIS = "axis_"  # before the name of a family's axis, which may be that of an array too
_NAMES = {"wavelength": "radiation_wavelength", "theta": "scattering_angle"}
_CONVENTIONS = {"Conventions": "CF-1.11"}


def library():
    """The module xarray; UsageError where it is not installed."""
    try:
        import xarray
    except ImportError as error:
        raise UsageError(f"xarray: {error}; get it by: {INSTALL}") from None
    return xarray


def dataset(root: Group, path: str) -> xarray.Dataset:
    """The arrays of one group with their coordinates, wherever in the asset those stand; groups in it have their own datasets."""
    variables, coordinates = _variables(root, path)
    dimensions = {name for variable in variables.values() for name in variable[0]} - coordinates.keys()
    for letter, name in COORDINATES.items():
        foreign = coordinate(root, f"{path}/-" if path else "-", letter)
        if name in dimensions and foreign is not None:
            coordinates[name] = _variable(root, foreign[0], (name,))
    return library().Dataset(variables, coordinates, _attributes(root, path))


def tree(root: Group) -> xarray.DataTree:
    """A whole asset: each group a node, coordinates where the asset keeps them."""
    xarray = library()
    paths = ["", *(path for path, member in root.walk() if isinstance(member, Group))]
    return xarray.DataTree.from_dict({f"/{path}": xarray.Dataset(*_variables(root, path, True), _attributes(root, path))
                                      for path in paths})


def _attributes(root: Group, path: str) -> dict[str, Any]:
    return _CONVENTIONS | {STORED: path} | (root[path] if path else root).attributes


def _variables(root: Group, path: str, inherited: bool = False) -> tuple[dict, dict]:
    """Variables and coordinates of one group, as (dimensions, values, attributes).

    inherited : of a node of a tree, which has the coordinates of those above and drops its own where they are the same
    """
    variables, coordinates = {}, {}
    for name, member in (root[path] if path else root).members.items():
        if isinstance(member, Dataset):
            whole = f"{path}/{name}" if path else name
            dimensions = () if is_text(member) else _dimensions(root, whole)
            if dimensions == (name,) and not (inherited and _above(root, path, name)):
                coordinates[name] = _variable(root, whole, dimensions)
            else:
                taken = name in COORDINATES.values()  # of the name of a coordinate that it is not, or not the first
                variables[f"{name}_of_{path.rpartition('/')[2]}" if taken else name] = _variable(root, whole, dimensions)
    if path == FAMILY:
        for axis, unit, values in of_points(root, f"{FAMILY}/members"):
            coordinates[_AXIS + axis] = ((_AXIS + axis,), values, {"units": unit})
    return variables, coordinates


def _above(root: Group, path: str, name: str) -> bool:
    """Whether a group above `path` holds an array of a name."""
    parts = path.split("/") if path else []
    return any(_has(root, "/".join([*parts[:n], name])) for n in range(len(parts)))


def _dimensions(root: Group, path: str) -> tuple[str, ...]:
    """A name for each axis: its coordinate's, else the letter that the stage gives to its length."""
    letters, points = axes(root, path), of_points(root, path)
    named = declared_letters(root, path)
    named = named if len(named) == len(letters) else ("",) * len(letters)
    group, _, name = path.rpartition("/")
    names = [_AXIS + axis for axis, _, _ in points]
    for i, letter in list(enumerate(letters))[len(points):]:
        if letter in COORDINATES:
            names.append(COORDINATES[letter])
        else:
            names.append("_".join([*group.split("/"), named[i]]) if named[i] and named.count(named[i]) == 1 else
                         "_".join([*group.split("/"), name, str(i)]))
    return tuple(names)


def _variable(root: Group, path: str, dimensions) -> tuple:
    member = root[path]
    attributes: dict[str, Any] = {"long_name": member.description, STORED: path}
    if is_text(member):
        return (), read_text(member), attributes
    name = path.rpartition("/")[2]
    attributes["units"] = member.units
    if dimensions == (name,) and name in _NAMES:
        attributes["standard_name"] = _NAMES[name]
    if member.choices:
        attributes |= {"flag_values": np.arange(len(member.choices), dtype=member.data.dtype),
                       "flag_meanings": " ".join(member.choices)}
    beside = [name + end for end in (ERROR, BIAS) if _has(root, path + end)]
    if beside:
        attributes["ancillary_variables"] = " ".join(beside)
    stated = stated_error(root, path)
    if stated is not None and stated.size:
        attributes["largest_error"] = float(stated.max())
    return dimensions, np.asarray(member.data), attributes


def _has(root: Group, path: str) -> bool:
    try:
        return isinstance(root[path], Dataset)
    except KeyError:
        return False


# ---- back


def group_of(labelled: xarray.Dataset) -> Group:
    """The group whose arrays a dataset holds: what `dataset` gave, with values, units and descriptions as they are now.

    Variables without `bakery_path` are new ones of the group; coordinates that stand elsewhere in the asset are left out.
    """
    path = str(labelled.attrs.get(STORED, ""))
    members = {}
    for name, variable in labelled.variables.items():
        parent, _, stored = str(variable.attrs.get(STORED, f"{path}/{name}" if path else name)).rpartition("/")
        if parent == path and (STORED in variable.attrs or name not in labelled.coords):
            members[stored] = _member(variable)
    attributes = {name: _plain(value) for name, value in labelled.attrs.items() if name not in (*_CONVENTIONS, STORED)}
    return Group(members, attributes)


def root_of(labelled: xarray.DataTree) -> Group:
    """The tree of an asset from what `tree` gave."""
    root = group_of(labelled.to_dataset(inherit=False))
    for name, node in labelled.children.items():
        root.members[name] = root_of(node)
    return root


def _member(variable) -> Dataset:
    attributes: Mapping[str, Any] = variable.attrs
    description = str(attributes.get("long_name", ""))
    if variable.dtype.kind in "OU":
        return text(str(variable.values.item()), description)
    choices = tuple(str(attributes["flag_meanings"]).split()) if "flag_meanings" in attributes else ()
    return Dataset(np.ascontiguousarray(variable.values), str(attributes.get("units", "1")), description, choices)


def _plain(value):
    """An attribute as assets keep it: files give NumPy's scalars."""
    return value.item() if isinstance(value, np.generic) or isinstance(value, np.ndarray) and value.size == 1 else value


def write_asset(root: Group, path: str | os.PathLike, overwrite: bool, inputs: Sequence[str] = ()) -> None:
    """Write a tree as an asset, after all that its stages check; inputs : files that it must not replace."""
    from bakery.stages.conform import violations
    from bakery.store.outputs import ASSET, check_outputs
    from bakery.store.write import write

    check_outputs([(path, ASSET)], inputs, overwrite)
    write(path, root, check=violations)
