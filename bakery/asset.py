"""An asset as Python sees it: `bakery.open(path)`, the only door through which renderers see one.

Every group has its datasets as attributes (`asset.medium.sigma_t`) and, exactly as stored, as items (`asset.medium["phase"]`).  A
tabulated phase function is an attribute that can be called with angles.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from types import MappingProxyType

import numpy as np

from bakery.errors import AssetError
from bakery.medium.phase import evaluate
from bakery.medium.regular import Loss, adaptive_table
from bakery.store.hashes import HASH, STAGE
from bakery.store.read import read
from bakery.store.tree import Dataset, Group, is_text, read_text

# Groups that a renderer may ask for, each with the recipe section that makes a bake write it.
SECTIONS = {"optics": "particles", "medium": "particles or medium", "packing": "packing", "grains": "grains",
            "multiple": "multiple_scattering", "beam": "beam", "discrete": "discrete"}
SOURCES = ("point", "segment")  # groups of `multiple` that can be called
ERROR = "_error"  # X_error is the standard error of X


class MissingStage(AssetError, AttributeError):
    """The asset is sound but was baked without the stage that is asked for."""


def open(path: str | os.PathLike) -> Asset:
    """An asset, read whole and checked.

    Parameters
    ----------
    path : of the asset file; it is closed again on return, later changes to it do not show

    Raises
    ------
    AssetError : missing, damaged, foreign, or of another format version; the text says which and what to do
    StoreError : the system would not read it

    Examples
    --------
    >>> asset = bakery.open("fog.h5")
    >>> asset.medium.phase(np.radians([0, 90, 180]))      # (L, 3) 1/sr
    """
    return Asset(read(path), os.fspath(path))


class Members(Mapping):
    """A group: datasets and groups by name, as attributes or as items.

    Attributes
    ----------
    attributes : of the group, such as `tolerance` and `achieved_error`
    units, description : name of a dataset -> its unit, its description
    choices : name of an enumeration -> names of its values 0, 1, ...
    error : name of a dataset -> its standard errors, where it has any
    """

    def __init__(self, group: Group, path: str, theta: np.ndarray | None = None):
        self._group, self._path = group, path
        datasets = {name: member for name, member in group.members.items() if isinstance(member, Dataset)}
        self.attributes = MappingProxyType(group.attributes)
        self.units = MappingProxyType({name: member.units for name, member in datasets.items()})
        self.description = MappingProxyType({name: member.description for name, member in datasets.items()})
        self.choices = MappingProxyType({name: member.choices for name, member in datasets.items() if member.choices})
        self.error = MappingProxyType({name.removesuffix(ERROR): _seen(member.data) for name, member in datasets.items()
                                       if name.endswith(ERROR) and name.removesuffix(ERROR) in datasets})
        own = datasets.get("theta")
        self._theta = own.data if own is not None else theta
        self._items = {name: self._item(name, member) for name, member in group.members.items()}

    def _item(self, name: str, member: Dataset | Group):
        if isinstance(member, Group):
            return Members(member, f"{self._path}/{name}", self._theta)
        if is_text(member):
            return read_text(member)
        return _seen(member.data)

    def __getitem__(self, name: str):
        """A member as it is stored: an array, text, or a group; `droplets/radius` goes down a group."""
        head, _, rest = name.partition("/")
        found = self._items[head]
        if rest and not isinstance(found, Members):
            raise KeyError(name)
        return found[rest] if rest else found

    def __getattr__(self, name: str):
        if name.startswith("_") or name not in self._items:
            held = ", ".join(self.__dict__.get("_items", ()))
            raise AttributeError(f"{self.__dict__.get('_path', 'group')} holds no {name!r}; it holds {held}")
        found = self._items[name]
        if name == "phase" and isinstance(found, np.ndarray) and self._theta is not None \
                and found.shape[-1] == len(self._theta):
            return Phase(self._theta, found, self.units[name])
        if name in SOURCES and self._path == "multiple":
            return self.__dict__.setdefault("_sources", {}).setdefault(name, Source(self._group, name))
        return found

    def __iter__(self) -> Iterator[str]:
        return iter(self._items)

    def __len__(self) -> int:
        return len(self._items)

    def __dir__(self):
        return [*super().__dir__(), *self._items]

    def __repr__(self) -> str:
        lines = [f"{self._path}{_summary(self.attributes)}"]
        for name, member in self._group.members.items():
            if isinstance(member, Group):
                lines.append(f"  {name}/  {', '.join(member.members)}")
            elif is_text(member):
                lines.append(f"  {name}  text, {member.data.size} bytes")
            else:
                lines.append(f"  {name} {_shape(member.data.shape)} {member.units}  {_range(member)}"
                             f"{_largest_error(member.data, self.error.get(name))}")
        return "\n".join(lines)


class Beam(Members):
    """The group `beam`: kernels of a narrow beam, by name."""

    def __init__(self, group: Group, medium: Group | None):
        super().__init__(group, "beam")
        self._medium = medium

    def kernel(self, depth, r, measure: str = "fluence") -> np.ndarray:
        """How a narrow beam of unit power spreads, (L, ...) mfp^-2, scattered light only.

        Parameters
        ----------
        depth, r : mean free paths, 0 or more; broadcast
        measure : fluence (all directions), forward, flux (power through a surface across the beam): the best ones.  For
            comparison single, small_angle, small_angle_absorbing, erf, path_integral, and elek, which is approximate

        Raises
        ------
        ValueError : another measure, deeper than the tables, negative

        Notes
        -----
        0 at depth 0; infinite on the axis (but for path_integral and elek).
        """
        return np.stack([one.kernel(depth, r, measure) for one in self._ready()])

    def layered(self, thickness, density, r, measure: str = "forward") -> np.ndarray:
        """The kernel behind layers of unequal density, (L, *r.shape), per square of the unit of length.

        Parameters
        ----------
        thickness, density : (N,) of the layers, from where the beam enters to the plane; the unit of length is the mean free path
            at density 1
        r : > 0
        measure : forward, flux; for comparison single, small_angle and erf

        Raises
        ------
        ValueError : another measure, an optical depth beyond the tables, no layers
        """
        return np.stack([one.layered(thickness, density, r, measure) for one in self._ready()])

    def _ready(self) -> list:
        if "_kernels" not in self.__dict__:
            if self._medium is None:
                raise MissingStage("kernels of a beam need the group medium, which is missing; bake the recipe again")
            from bakery.stages.beam import kernels_of

            self._kernels = kernels_of(self._group, self._medium)
        return self._kernels


class One(np.ndarray):
    """An array of one number that also passes for the number: the file holds no scalars, users of a fraction expect one."""

    def __float__(self) -> float:
        return float(self.item())

    def __int__(self) -> int:
        return int(self.item())

    def __format__(self, spec: str) -> str:
        return format(self.item(), spec) if spec else str(self)


def _seen(data: np.ndarray) -> np.ndarray:
    return data.view(One) if data.shape == (1,) else data


class Phase:
    """A tabulated phase function: linear in cos theta between its angles, its integral over the sphere is 1.

    Attributes
    ----------
    theta : (A,) rad, ascending from 0 (forward) to pi
    table : (..., A) 1/sr
    """

    def __init__(self, theta: np.ndarray, table: np.ndarray, units: str = "1/sr"):
        self.theta, self.table, self.units = theta, table, units

    def __call__(self, theta) -> np.ndarray:
        """Values at angles of any shape, (..., *theta.shape) 1/sr; ValueError outside 0 .. pi."""
        return evaluate(self.theta, self.table, theta)

    def regular(self, row: int = 0, limit: float = 1e-3) -> tuple[np.ndarray, Loss]:
        """One row of the table on equidistant cosines from -1 to +1, as `tabphase` of stock renderers wants it, and the loss.

        See `bakery.medium.regular.adaptive_table`; values (N,) float32, 1/sr.
        """
        return adaptive_table(self.theta, self.table[row], limit)

    def __array__(self, dtype=None, copy=None) -> np.ndarray:
        return np.array(self.table, dtype, copy=copy)

    def __repr__(self) -> str:
        return f"phase(theta) {_shape(self.table.shape)} {self.units}, {len(self.theta)} angles from 0 to pi"


class Source:
    """Light that a point or a segment source sends into a direction by its third and later scattering events."""

    def __init__(self, group: Group, kind: str):
        self._group, self.kind, self._tables = group, kind, None

    def __call__(self, rho, z, theta, phi, length: float | None = None) -> np.ndarray:
        """Per unit volume and unit power, (L, ...) mfp^-3 sr^-1; arguments broadcast.

        Parameters
        ----------
        rho, z : cylindrical coordinates about the source, mean free paths of the medium; light enters along +z
        theta, phi : rad, direction of travel: from +z, from the azimuth of the position
        length : of a segment, mean free paths, 0 or more; that of the table by default

        Raises
        ------
        ValueError : a length for a point source, or below 0
        MissingStage : only the other kind of source was baked
        """
        from bakery.multiple import lookup

        if self.kind == "point" and length is not None:
            raise ValueError("a point source has no length")
        if length is not None and not length >= 0:
            raise ValueError(f"length {length}: 0 or more mean free paths")
        tables = self._ready()
        values = []
        for point, segment, stretch in tables:
            at = np.multiply(rho, stretch), np.multiply(z, stretch), theta, phi
            if self.kind == "point":
                found = lookup.point(point, *at)
            else:
                own = None if length is None else length * stretch
                found = lookup.segment(point, segment, *at, own)
            values.append(found * stretch**3)
        return np.stack(values)

    def _ready(self):
        if self._tables is None:
            from bakery.multiple import lookup
            from bakery.stages.multiple import tables_of

            made = {}
            for kind in ("point", self.kind):
                if kind not in self._group.members:
                    raise MissingStage(f"the tables of a {self.kind} source need those of a {kind} source too; bake them with "
                                       "multiple_scattering: {sources: [point, segment]}")
                made[kind] = [lookup.ready(table) for table in tables_of(self._group, kind)]
            stretch = self._group["extinction"].data
            self._tables = list(zip(made["point"], made[self.kind], stretch, strict=True))
        return self._tables

    def __repr__(self) -> str:
        return f"{self.kind}(rho, z, theta, phi{', length=None' * (self.kind == 'segment')}) mfp^-3 sr^-1"


class Asset:
    """One baked material, read-only.

    Attributes
    ----------
    path, name, content_hash : text
    recipe : the recipe's text
    wavelength : (L,) um, in vacuum
    stages : name -> attributes of the stage (`tolerance`, `achieved_error`, `error_measure`, `input_hash`, ...)
    provenance : group; when, with which versions and command, seconds and memory of each stage
    attributes : of the root
    optics, medium, packing, grains, multiple, beam, discrete : the groups that were baked, each a `Members`
    """

    def __init__(self, root: Group, path: str):
        self.path = path
        self.attributes = MappingProxyType(root.attributes)
        self.name = str(root.attributes.get("name", ""))
        self.content_hash = str(root.attributes.get(HASH, ""))
        try:
            self.wavelength, self.recipe = root["wavelength"].data, read_text(root["recipe"])
        except (KeyError, AttributeError):
            raise AssetError(f"{path}: holds no recipe and wavelength: an entry of bakery's cache, not an asset") from None
        except UnicodeDecodeError:
            raise AssetError(f"{path}: damaged: recipe: not UTF-8 text") from None
        medium = root.members.get("medium")
        theta = medium.members.get("theta") if isinstance(medium, Group) else None
        shared = theta.data if isinstance(theta, Dataset) else None
        self._groups = {name: Members(member, name, shared) for name, member in root.members.items() if isinstance(member, Group)}
        if "beam" in self._groups:
            self._groups["beam"] = Beam(root.members["beam"], medium if isinstance(medium, Group) else None)
        self.stages = MappingProxyType({name: group.attributes for name, group in self._groups.items()
                                        if STAGE in group.attributes})
        self.tree = root

    def __getattr__(self, name: str):
        groups = self.__dict__.get("_groups", {})
        if name in groups:
            return groups[name]
        if name in SECTIONS:
            raise MissingStage(f"{self.path}: holds no stage {name!r} (it holds {', '.join(self.stages) or 'none'}); give its "
                               f"recipe a section `{SECTIONS[name]}` and bake it again: `bake RECIPE -o {self.path}`")
        raise AttributeError(f"an asset has no attribute {name!r}; {self.path} holds the groups {', '.join(groups)}")

    def __dir__(self):
        return [*super().__dir__(), *self._groups]

    def __repr__(self) -> str:
        lines = [f"asset {self.name!r}, {len(self.wavelength)} wavelengths {_range_of(self.wavelength)} um, "
                 f"content {self.content_hash[:12]}"]
        lines += [f"  {name}: {', '.join(self._groups[name])}{_summary(stage)}" for name, stage in self.stages.items()]
        return "\n".join(lines)


def _summary(attributes: Mapping) -> str:
    achieved, tolerance = attributes.get("achieved_error"), attributes.get("tolerance")
    if not isinstance(achieved, float) or not isinstance(tolerance, float):
        return ""
    return f"  (error {achieved:.2g} of {tolerance:.2g}, {attributes.get('error_measure', '')})"


def _shape(shape: tuple[int, ...]) -> str:
    return "(" + ", ".join(map(str, shape)) + ("," if len(shape) == 1 else "") + ")"


def _range(dataset: Dataset) -> str:
    if dataset.choices:
        held = [name for i, name in enumerate(dataset.choices) if (dataset.data == i).any()]
        return " or ".join(held)
    return _range_of(dataset.data) if dataset.data.dtype.kind in "fiu" else str(dataset.data.dtype)


def _range_of(data: np.ndarray) -> str:
    if data.size == 0:
        return "empty"
    low, high = data.min(), data.max()
    return f"{low:.4g}" if low == high else f"{low:.4g} .. {high:.4g}"


def _largest_error(data: np.ndarray, error: np.ndarray | None) -> str:
    if error is None or error.shape != data.shape or not error.size:
        return ""
    return f"  +- {error.max():.2g}"
