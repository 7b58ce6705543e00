"""Groups of an asset as Python sees them: members by name, phase functions that can be called, numbers that pass for floats."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from bakery.draw.html import table
from bakery.errors import AssetError, UsageError
from bakery.grammar.units import is_list
from bakery.physics.medium import spectral
from bakery.physics.medium.phase import phase_at
from bakery.physics.medium.regular import Loss, adaptive_table
from bakery.stages.coordinates import BIAS, ERROR, stated_error, wavelengths
from bakery.stages.declaration import later
from bakery.store.missed import too_large
from bakery.store.tree import Dataset, Group, is_text, read_text

if TYPE_CHECKING:
    import xarray

    from bakery.draw.picture import Picture

HEADLINES = ("sigma_t", "albedo", "g", "hit_probability", "fraction")  # what a summary shows of a group, where it holds them
_FEW, _NAMED = 3, 5  # so many values are shown themselves, so many members are named

_drawing = later("bakery.stages.medium.pictures:phase_function")


def medium_theta(root: Group) -> np.ndarray | None:
    """The angles (A,) of an asset's medium, over which phase functions stand that have none of their own."""
    medium = root.groups.get("medium")
    return medium["theta"].data if medium is not None and "theta" in medium.datasets else None


class MissingStage(AssetError, AttributeError):
    """The asset is sound but was baked without the stage that is asked for.

    brief : the same where it is known which asset is meant, and nothing has to be done
    """

    brief = ""


class Members(Mapping):
    """A group: datasets and groups by name, as attributes or as items.

    Attributes
    ----------
    attributes : of the group, such as `tolerance` and `achieved_error`
    units, description : name of a dataset -> its unit, its description
    choices : name of an enumeration -> names of its values 0, 1, ...
    error : name of a dataset -> its standard errors, where it has any
    bias : name of a dataset -> the estimated size of its systematic errors, where they are stored
    """

    _root: Group | None = None
    _labelled: Callable[[Group, str], xarray.Dataset] | None = None

    def __init__(self, group: Group, path: str, theta: np.ndarray | None = None, wavelength: np.ndarray | None = None):
        self._group, self._path, self._wavelength = group, path, wavelength
        datasets = group.datasets
        self.attributes = MappingProxyType(group.attributes)
        self.units = MappingProxyType({name: member.units for name, member in datasets.items()})
        self.description = MappingProxyType({name: member.description for name, member in datasets.items()})
        self.choices = MappingProxyType({name: member.choices for name, member in datasets.items() if member.choices})
        self.error, self.bias = (MappingProxyType({name.removesuffix(end): _with_unit(member) for name, member in datasets.items()
                                                   if name.endswith(end) and name.removesuffix(end) in datasets})
                                 for end in (ERROR, BIAS))
        angles = datasets.get("theta")
        self._theta = angles.data if angles is not None else theta
        self._items = {name: self._item(name, member) for name, member in group.members.items()}

    def within(self, root: Group, labelled: Callable[[Group, str], xarray.Dataset]) -> None:
        """Tell the group, and those in it, of the asset that it is part of, and of what makes labelled arrays of one."""
        self._root, self._labelled = root, labelled
        for item in self._items.values():
            if isinstance(item, Members):
                item.within(root, labelled)

    def to_xarray(self) -> xarray.Dataset:
        """The arrays of the group with their coordinates, units, descriptions and errors (`bakery.asset.labelled`).

        Groups in it have their own: `asset.optics["drops"].to_xarray()`.  UsageError where xarray is not installed.
        """
        if self._labelled is None:
            raise UsageError(f"{self._path}: only groups of an asset become labelled arrays")
        return self._labelled(self._root, self._path)

    def _item(self, name: str, member: Dataset | Group):
        if isinstance(member, Group):
            return Members(member, f"{self._path}/{name}", self._theta, self._wavelength)
        if is_text(member):
            return read_text(member)
        return _with_unit(member)

    def __getitem__(self, name: str):
        """A member as it is stored: an array (`Values`, with its unit), text, or a group; `droplets/radius` goes down a group."""
        head, _, inner = name.partition("/")
        member = self._items[head]
        if inner and not isinstance(member, Members):
            raise KeyError(name)
        return member[inner] if inner else member

    def __getattr__(self, name: str):
        if name.startswith("_") or name not in self._items:
            names = ", ".join(self.__dict__.get("_items", ()))
            raise AttributeError(f"{self.__dict__.get('_path', 'group')} holds no {name!r}; it holds {names}")
        member = self._items[name]
        if name == "phase" and isinstance(member, np.ndarray) and self._theta is not None \
                and member.shape[-1] == len(self._theta):
            error = stated_error(self._group, "phase")  # else what its stage has reached
            error = self["phase"] * float(self.attributes.get("achieved_error", 0.0)) if error is None else error
            return Phase(self._theta, member, self.units[name], self._wavelength, error)
        return member

    def __iter__(self) -> Iterator[str]:
        return iter(self._items)

    def __len__(self) -> int:
        return len(self._items)

    def __dir__(self):
        return [*super().__dir__(), *self._items]

    def __repr__(self) -> str:
        lines = [f"{self._path}{summary(self.attributes)}"]
        for name, shape, units, values, error in self._rows():
            error = f"  +- {error}" if error else ""
            lines.append(f"  {name} {shape} {units}  {values}{error}" if units else f"  {name}  {values}")
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        rows = [[*row, self.description.get(row[0], "")] for row in self._rows()]
        return table(("", "shape", "unit", "values", "error up to", ""), rows, 6, f"{self._path}{summary(self.attributes)}")

    def _rows(self) -> Iterator[tuple[str, str, str, str, str]]:
        """Name, shape, unit, range and largest error of every member, in words."""
        for name, member in self._group.members.items():
            if isinstance(member, Group):
                yield f"{name}/", "", "", ", ".join(member.members), ""
            elif is_text(member):
                yield name, "", "", f"text, {member.data.size} bytes", ""
            else:
                error = stated_error(self._group, name)
                largest = "" if error is None or not error.size else f"{error.max():.2g}"
                yield name, _shape(member.data.shape), member.units, _range(member), largest


class Values(np.ndarray):
    """An array with a unit: `units`, "1" for pure numbers.

    Slices and copies keep the unit.  Arithmetic gives plain arrays without a unit.
    """

    units = ""

    def __array_finalize__(self, source):
        self.units = getattr(source, "units", "")

    def __array_wrap__(self, array, context=None, return_scalar=False):
        plain = array.view(np.ndarray)
        return plain[()] if return_scalar else plain

    def __reduce__(self):
        make, arguments, state = super().__reduce__()
        return make, arguments, (state, self.units)

    def __setstate__(self, state):
        super().__setstate__(state[0])
        self.units = state[1]

    def __repr__(self) -> str:
        return np.array_repr(self.view(np.ndarray)) + (f" {self.units}" if self.units not in ("", "1") else "")


class One(Values):
    """An array of one number that also passes for the number: the file holds no scalars, users of a fraction expect one."""

    def __array_wrap__(self, array, context=None, return_scalar=False):
        plain = super().__array_wrap__(array, context, return_scalar)
        return plain.view(One) if isinstance(plain, np.ndarray) and plain.shape == (1,) else plain

    def __float__(self) -> float:
        return float(self.item())

    def __int__(self) -> int:
        return int(self.item())

    def __format__(self, spec: str) -> str:
        return format(self.item(), spec) if spec else str(self)


def with_units(data: np.ndarray, units: str) -> Values:
    """The same array, which knows its unit."""
    values = data.view(Values)
    values.units = units
    return values


def _with_unit(member: Dataset) -> Values:
    values = with_units(member.data, member.units)
    return values.view(One) if values.shape == (1,) else values


class Phase:
    """A tabulated phase function: linear in cos theta between its angles, its integral over the sphere is 1.

    Attributes
    ----------
    theta : (A,) rad, ascending from 0 (forward) to pi
    table : (..., A) 1/sr
    wavelength : (L,) um, of the rows of a table (L, A); None where that is not known
    error : like `table`, absolute; None where it is not known
    """

    def __init__(self, theta: np.ndarray, table: np.ndarray, units: str = "1/sr", wavelength: np.ndarray | None = None,
                 error: np.ndarray | None = None):
        self.theta, self.table, self.units, self.wavelength, self.error = theta, table, units, wavelength, error

    def __call__(self, theta, wavelength=None) -> np.ndarray:
        """Values at angles of any shape, (..., *theta.shape) 1/sr; ValueError outside 0 .. pi.

        wavelength : um or text with its unit, also between the baked ones (`at`); a single one has no axis in what is returned
        """
        if wavelength is None:
            return phase_at(self.theta, self.table, theta)
        values = phase_at(self.theta, self.at(wavelength).table, theta)
        return values if np.ndim(wavelength) or isinstance(wavelength, str) and is_list(wavelength) else values[0]

    def at(self, wavelength) -> Phase:
        """The phase function at wavelengths, (W, A), each angle a power of the wavelength between its neighbours.

        `error` is that of the table and what leaving out neighbouring wavelengths shows the interpolation to be off by; not a
        number where only two wavelengths are baked.  UsageError outside of the baked ones.
        """
        if self.wavelength is None or self.table.shape != (len(self.wavelength), len(self.theta)):
            raise UsageError(f"only phase functions of one row a wavelength are interpolated; this is a table "
                             f"{_shape(self.table.shape)}")
        wanted, theta, table = np.atleast_1d(wavelengths(wavelength, self.wavelength)), self.theta, np.asarray(self.table)
        stored = np.asarray(self.wavelength)

        def rows(around):
            return spectral.phase_functions(around, theta, table)

        around = spectral.places(stored, wanted)
        error = spectral.missed(stored, wanted, rows, table, over_angles=True)
        if self.error is not None:
            error = error + spectral.interpolated(around, self.error)
        return Phase(theta, rows(around), self.units, wanted, error)

    def regular(self, row: int = 0, limit: float = 1e-3) -> tuple[np.ndarray, Loss]:
        """One row of the table on equidistant cosines from -1 to +1, as `tabphase` of stock renderers wants it, and the loss.

        See `bakery.physics.medium.regular.adaptive_table`; values (N,) float32, 1/sr.
        """
        return adaptive_table(self.theta, self.table[row], limit)

    def plot(self) -> Picture:
        """A picture over the scattering angle, one curve a wavelength; notebooks show it, `columns` holds its numbers.

        Raises UsageError for a table that is not one row a wavelength, as one of grains by radius.
        """
        if self.wavelength is None or self.table.shape != (len(self.wavelength), len(self.theta)):
            raise UsageError(f"phase functions are drawn as one curve a wavelength; this is a table {_shape(self.table.shape)}")
        members = {"theta": self.theta, "phase": self.table, "phase" + ERROR: self.error}
        shown = Group({name: Dataset(np.asarray(data), "", "") for name, data in members.items() if data is not None})
        return _drawing(shown, np.asarray(self.wavelength))

    def _repr_html_(self) -> str | None:
        return None if self.wavelength is None or self.table.ndim != 2 else self.plot()._repr_html_()

    def __array__(self, dtype=None, copy=None) -> np.ndarray:
        return np.array(self.table, dtype, copy=copy)

    def __repr__(self) -> str:
        return f"phase(theta) {_shape(self.table.shape)} {self.units}, {len(self.theta)} angles from 0 to pi"


def summary(attributes: Mapping) -> str:
    """A stage's error against its tolerance, in words; what is measured stands in its attribute `error_measure`."""
    achieved, tolerance = attributes.get("achieved_error"), attributes.get("tolerance")
    if not isinstance(achieved, float) or not isinstance(tolerance, float):
        return ""
    mark = ", MISSED" if too_large(attributes) else ""
    return f"  error {achieved:.2g} of {tolerance:.2g}{mark}"


def headline(group: Members) -> str:
    """The figures that one asks a group for first, with units and largest relative errors, and what else it holds, in a line."""
    shown = [f"{name} {in_words(group[name], group.units[name], stated_error(group._group, name))}" for name in HEADLINES
             if isinstance(group.get(name), np.ndarray) and group[name].size]
    names = [name for name in group if name not in HEADLINES]
    shown_more = max(_NAMED - len(shown), 0)
    named = [f"{name}/" if isinstance(group[name], Members) else name for name in names[:shown_more]]
    return ", ".join(shown + named) + (f" and {len(names) - shown_more} more" if len(names) > shown_more else "")


def in_words(data: np.ndarray, units: str, error: np.ndarray | None = None) -> str:
    """Values, or their range where they are many, with unit and largest relative error."""
    text = " ".join(f"{x:.6g}" for x in data.flat) if data.size <= _FEW else range_of(data)
    text += f" {units}" if units not in ("", "1") else ""
    if error is None or error.shape != data.shape or not np.any(data != 0):
        return text
    worst = np.max(np.divide(error, np.abs(data), out=np.zeros(data.shape), where=data != 0))
    return f"{text} +- {100 * worst:.2g} %"


def _shape(shape: tuple[int, ...]) -> str:
    return "(" + ", ".join(map(str, shape)) + ("," if len(shape) == 1 else "") + ")"


def _range(dataset: Dataset) -> str:
    if dataset.choices:
        present = [name for i, name in enumerate(dataset.choices) if (dataset.data == i).any()]
        return " or ".join(present)
    return range_of(dataset.data) if dataset.data.dtype.kind in "fiu" else str(dataset.data.dtype)


def range_of(data: np.ndarray) -> str:
    """Smallest and largest value in words."""
    if data.size == 0:
        return "empty"
    low, high = data.min(), data.max()
    return f"{low:.4g}" if low == high else f"{low:.4g} .. {high:.4g}"
