"""A family of assets as Python sees it: its axes, its members, and the asset of any place between them."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from bakery.asset import labelled
from bakery.asset.ask import ask, reals
from bakery.asset.single import Asset, read_checked, rendered
from bakery.draw.html import first_picture, table
from bakery.errors import AssetError, UsageError
from bakery.family.axes import Swept
from bakery.family.members import counted, listed
from bakery.family.pictures import pictures
from bakery.family.point import asset_at, place_of, place_path
from bakery.family.tree import axes_of, error_of
from bakery.grammar.fields import nearest
from bakery.grammar.text import show
from bakery.grammar.units import Wrong, naming, parse, quantity_of
from bakery.stages import sections_for
from bakery.stages.conform import FAMILY
from bakery.stages.declaration import Answer
from bakery.stages.members import MissingStage, Values, with_units
from bakery.store.hashes import HASH
from bakery.store.tree import Attribute, Dataset, Group, read_text

if TYPE_CHECKING:
    import xarray


@dataclass(frozen=True)
class FamilyAxis:
    """One axis of a family.

    Attributes
    ----------
    key : of the recipe
    values : (N,) of the points, ascending; in `values.units`: m, 1/m^3, 1/m, rad or 1
    logarithmic : whether is interpolated in their logarithm
    error : (N - 1,) measured half-way between a point and the next, in the measure of `achieved_error`; not a number where that
        failed, None where nothing was measured
    """

    key: str
    values: Values
    logarithmic: bool
    error: np.ndarray | None


@dataclass(frozen=True)
class FamilyMember:
    """One point of a family.

    Attributes
    ----------
    at : name of the axis -> value, as `Family.at` takes them
    path : of the asset, where there is one
    content_hash : of that asset
    reason : why there is none, else ""
    """

    at: Mapping[str, float]
    path: Path
    content_hash: str
    reason: str

    def open(self) -> Asset:
        """The asset itself, with all that was baked.  Raises AssetError, StoreError."""
        if self.reason:
            raise AssetError(f"{self.path}: was not baked: {self.reason}")
        return Asset(read_checked(self.path), os.fspath(self.path))


class Interpolated(Asset):
    """An asset between the points of a family: the group `medium` alone.  Its `path` is where it would be saved."""

    def save(self, path: str | os.PathLike, overwrite: bool = False) -> Path:
        """Write it as an ordinary asset, whose provenance says where it comes from.

        Raises
        ------
        UsageError : nothing can be written there, it is the family, or (but for `overwrite`) what stands there is no asset
        StoreError : the system refused
        """
        labelled.write_asset(self.tree, path, overwrite, [str(self.provenance.attributes["family"])])
        return Path(path)


class Family:
    """Assets over one or more swept values, read-only.

    Attributes
    ----------
    path, name, content_hash : text
    recipe : the recipe's text
    wavelength : (L,) um, in vacuum
    axes : name -> `FamilyAxis`
    members : tuple of `FamilyMember`, the last axis fastest
    method : of interpolation, cubic or linear
    tolerance : of the interpolation
    achieved_error : of the interpolation; None where it was not measured
    tree : groups and datasets as they are stored
    stages : none, where an asset names its own
    """

    stages: Mapping = MappingProxyType({})

    def __init__(self, root: Group, path: str):
        self.tree, self.path = root, path
        family = root.members[FAMILY]
        self.name, self.content_hash = (str(root.attributes.get(key, "")) for key in ("name", HASH))
        self.recipe = read_text(root["recipe"])
        self.wavelength = with_units(root["wavelength"].data, root["wavelength"].units)
        self.method, self.tolerance = family.attributes["method"], family.attributes["tolerance"]
        self.achieved_error = family.attributes.get("achieved_error")
        self._swept = {axis.first.name: axis.first for axis in axes_of(family)}
        groups = family["axes"].members
        self.axes = MappingProxyType({name: FamilyAxis(
            key.key, with_units(groups[name]["value"].data, groups[name]["value"].units), key.logarithmic, error_of(groups[name]))
            for name, key in self._swept.items()})
        folder = Path(path).parent
        self.members = tuple(FamilyMember(MappingProxyType(dict(zip(self._swept, index, strict=True))), folder / member.file,
                                          member.content_hash, member.reason) for index, _, member in listed(root))

    def __fspath__(self) -> str:
        return self.path

    def to_xarray(self) -> xarray.DataTree:
        """The family as xarray's labelled arrays, its tables over its axes (`bakery.asset.labelled`)."""
        return labelled.tree(self.tree)

    def at(self, **values: float | str) -> Interpolated:
        """The asset at a place: its group `medium`, interpolated.

        Parameters
        ----------
        values : one for each axis, in the units of `axes` (a radius in m) or as text with any unit, `radius="5 um"`

        Raises
        ------
        UsageError : an axis that there is not, or no value for one, or one outside of the points
        AssetError : a point that the place needs has failed

        Examples
        --------
        >>> clouds = bakery.open("clouds.h5")                     # doctest: +SKIP
        >>> clouds.at(radius=5e-6).medium.g                       # doctest: +SKIP
        """
        unknown = [name for name in values if name not in self.axes]
        missing = [name for name in self.axes if name not in values]
        if unknown or missing:
            axes = ", ".join(f"{name} ({axis.values.units})" for name, axis in self.axes.items())
            fault = f'found "{unknown[0]}"' if unknown else f"found no value of {missing[0]}"
            steps = {key.name: axis.first.name for axis in axes_of(self.tree.members[FAMILY]) for key in axis.keys[1:]}
            if unknown and unknown[0] in steps:
                raise UsageError(f"{self.path}: {fault}, which goes in step with {steps[unknown[0]]}; give {steps[unknown[0]]}")
            near = nearest(unknown[0], self.axes) if unknown else ""
            raise UsageError(f"{self.path}: {fault}; the axes of the family are {axes}{near}")
        point = place_of(self.tree, [_number(self._swept[name], values[name]) for name in self.axes])
        root = asset_at(self.tree, self.path, point)
        for _, member in root.walk():
            if isinstance(member, Dataset):
                member.data.flags.writeable = False
        return Interpolated(root, place_path(self.path, self.tree, point))

    def query(self, path: str, /, **arguments: str | float | Sequence[float]) -> Answer | Attribute:
        """A value of the family's own, such as `family/sigma_t`, as `Asset.query`; `at(…).query(…)` asks the asset of a place."""
        return ask(self, path, arguments)

    def __getattr__(self, name: str):
        if sections_for(name):
            axes = ", ".join(f"{axis}=…" for axis in self.__dict__.get("axes", ()))
            raise MissingStage(f"{self.path}: is a family of assets, which has no {name!r} of its own: `at({axes})` gives the "
                               "asset of a place, on the command line --at does")
        raise AttributeError(f"a family has no attribute {name!r}")

    def __repr__(self) -> str:
        lines = [f"  {name}  {values}, {key}" for name, values, key in self._rows()]
        return "\n".join([f"family {self._title()}", *lines])

    def _repr_html_(self) -> str:
        # where there is one point alone, nothing lies between: it is drawn itself, as `bake plot` does
        drawn = pictures(self.tree) if len(self.members) > 1 else rendered(self.at(**self.members[0].at).tree)
        return table(("axis", "values", "key of the recipe"), self._rows(), 3, f"Family {self._title()}") + first_picture(drawn)

    def _title(self) -> str:
        reached = "not measured" if self.achieved_error is None else f"{self.achieved_error:.2g} of {self.tolerance:.2g}"
        assets = counted([member.reason for member in self.members])
        return (f"{self.name!r}, {assets}, {self.method} between them, error {reached}, "
                f"content {self.content_hash[:12]}")

    def _rows(self) -> list[tuple[str, str, str]]:
        return [(name, _span(axis.values), axis.key) for name, axis in self.axes.items()]


def _span(values: Values) -> str:
    """The values of an axis in words."""
    unit = f" {values.units}".removesuffix(" 1")
    return f"{len(values)} values, {values[0]:.6g} to {values[-1]:.6g}{unit}" if len(values) > 1 else f"{values[0]:.6g}{unit}"


def _number(axis: Swept, value: float | str) -> float:
    """A value in the units of an axis."""
    if not isinstance(value, str):
        values = reals(value)
        if len(values) == 1:
            return values[0]
        raise UsageError(f"{axis.name}: found {show(value)}; expected one number, or text with a unit")
    with naming(axis.name):
        quantity = quantity_of(value)
        if quantity.base != axis.units:
            unit = f" such as 5 {quantity_of(f'1 {axis.units}').suggested}" if axis.units != "1" else " without unit"
            raise Wrong(f'found "{value}"', f"expected a number{unit}")
        return parse(value, quantity)
