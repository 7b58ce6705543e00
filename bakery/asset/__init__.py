"""An asset as Python sees it: `bakery.open(path)`, the only interface through which renderers see one.

Every group has its datasets as attributes (`asset.medium.sigma_t`) and, exactly as stored, as items (`asset.medium["phase"]`).  A
tabulated phase function is an attribute that can be called with angles.
"""

from __future__ import annotations

import os
from types import MappingProxyType

from bakery.errors import AssetError
from bakery.stages.members import Members, MissingStage, headline, in_words, with_units
from bakery.stages.members import summary as in_short  # `summary` is also a module of this package
from bakery.stages.sources import Beam, Multiple
from bakery.store.hashes import HASH, STAGE
from bakery.store.read import read
from bakery.store.tree import Dataset, Group, read_text

# Groups that a renderer may ask for, each with the recipe section that makes a bake write it.
SECTIONS = {"optics": "particles", "medium": "particles or medium", "packing": "packing", "grains": "grains",
            "multiple": "multiple_scattering", "beam": "beam", "discrete": "discrete"}


def open(path: str | os.PathLike) -> Asset:
    """An asset, read whole and checked.

    Parameters
    ----------
    path : of the asset file; it is closed again on return, later changes to it do not show

    Raises
    ------
    AssetError : missing, damaged, foreign, of another format version, or not what its stages declare; the text says which and
        what to do
    StoreError : the system would not read it

    Examples
    --------
    >>> asset = bakery.open("fog.h5")
    >>> asset.medium.phase(np.radians([0, 90, 180]))      # (L, 3) 1/sr
    """
    return Asset(read_checked(path), os.fspath(path))


def read_checked(path: str | os.PathLike) -> Group:
    """The tree of an asset that is what its stages declare; what every command starts from.  Raises as `open`."""
    from bakery.stages import conform

    root = read(path)
    if not {"wavelength", "recipe"} <= root.members.keys():
        raise AssetError(f"{os.fspath(path)}: holds no recipe and wavelength: an entry of bakery's cache, not an asset")
    conform.check(os.fspath(path), root)
    return root


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
        wavelength, self.recipe = root["wavelength"], read_text(root["recipe"])
        self.wavelength = with_units(wavelength.data, wavelength.units)
        medium = root.members.get("medium")
        theta = medium.members.get("theta") if isinstance(medium, Group) else None
        shared = theta.data if isinstance(theta, Dataset) else None
        self._groups = {name: Members(member, name, shared) for name, member in root.members.items() if isinstance(member, Group)}
        if "beam" in self._groups:
            self._groups["beam"] = Beam(root.members["beam"], medium if isinstance(medium, Group) else None)
        if "multiple" in self._groups:
            self._groups["multiple"] = Multiple(root.members["multiple"], shared)
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
        lines = [f"asset {self.name!r}, wavelength {in_words(self.wavelength, self.wavelength.units)}, "
                 f"content {self.content_hash[:12]}"]
        lines += [f"  {name}{in_short(stage)}: {headline(self._groups[name])}" for name, stage in self.stages.items()]
        return "\n".join(lines)
