"""One baked material, and the check that every command starts from."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING

from bakery.asset import labelled
from bakery.asset.ask import ask
from bakery.draw.html import first_picture, table
from bakery.draw.picture import Picture
from bakery.errors import AssetError
from bakery.family.tree import departures, is_family
from bakery.stages import all_stages, conform, sections_in_words
from bakery.stages.conform import stages_of
from bakery.stages.declaration import Answer
from bakery.stages.members import Members, MissingStage, headline, in_words, medium_theta, with_units
from bakery.stages.members import summary as error_of  # `summary` is a module of this package
from bakery.store.hashes import HASH, STAGE
from bakery.store.read import read
from bakery.store.tree import Attribute, Group, read_text

if TYPE_CHECKING:
    import xarray


def read_checked(path: str | os.PathLike) -> Group:
    """The tree of an asset that is what its stages declare; what every command starts from.  Raises as `bakery.open`."""
    return checked(os.fspath(path), read(path))


def checked(path: str, root: Group) -> Group:
    """A tree that is what its stages declare; AssetError where it is not."""
    if not {"wavelength", "recipe"} <= root.members.keys():
        raise AssetError(f"{path}: holds no recipe and wavelength: an entry of bakery's cache, not an asset")
    conform.check(path, root)
    if is_family(root) and (faults := departures(root)):
        raise AssetError(f"{path}: damaged, or not written by bakery: {faults[0]}; `bake verify` lists all")
    return root


def rendered(root: Group) -> Iterator[Picture]:
    """Pictures of what renderers take of an asset."""
    return (picture for stage in stages_of(root) if stage.rendered for picture in stage.pictures(root))


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
    NAME : each baked group, by its stage's name (`medium`): `Members`, or the class that the stage declares
    """

    def __init__(self, root: Group, path: str):
        self.path = path
        self.attributes = MappingProxyType(root.attributes)
        self.name = str(root.attributes.get("name", ""))
        self.content_hash = str(root.attributes.get(HASH, ""))
        wavelength, self.recipe = root["wavelength"], read_text(root["recipe"])
        self.wavelength = with_units(wavelength.data, wavelength.units)
        shared = medium_theta(root)
        views = {stage.name: stage.view for stage in all_stages() if stage.view}
        self._groups = {name: views[name](root) if name in views else Members(member, name, shared, self.wavelength)
                        for name, member in root.groups.items()}
        for group in self._groups.values():
            group.within(root, labelled.dataset)
        self.stages = MappingProxyType({name: group.attributes for name, group in self._groups.items()
                                        if STAGE in group.attributes})
        self.tree = root

    def __getattr__(self, name: str):
        groups = self.__dict__.get("_groups", {})
        if name in groups:
            return groups[name]
        if wanted := sections_in_words(name):
            missing = MissingStage(f"{self.path}: holds no stage {name!r} (it holds {', '.join(self.stages) or 'none'}); give "
                                   f"its recipe a section {wanted} and bake it again: `bake RECIPE -o {self.path}`, or "
                                   f"`bake RECIPE --scene SCENE -o {self.path}` of a scene that needs the stage")
            missing.brief = f"the asset holds no stage {name!r}"
            raise missing
        raise AttributeError(f"an asset has no attribute {name!r}; {self.path} holds the groups {', '.join(groups)}")

    def __fspath__(self) -> str:
        return self.path

    def query(self, path: str, /, **arguments: str | float | Sequence[float]) -> Answer | Attribute:
        """A baked value, looked up at arguments as `bake query` does.

        Parameters
        ----------
        path : such as `medium/phase`
        arguments : text with its unit, `theta="10 deg"`, or numbers: wavelength and radius in um, theta in rad

        Returns
        -------
        answer : `values` with `units`, `axes`, `error` and `remarks`; text and attributes (`medium/achieved_error`) as they are

        Raises
        ------
        UsageError : a missing path, an argument that has no effect on it or is outside of the stored range

        Examples
        --------
        >>> asset.query("medium/phase", wavelength="550 nm", theta="[0, 90, 180] deg").values       # doctest: +SKIP
        """
        return ask(self, path, arguments)

    def to_xarray(self) -> xarray.DataTree:
        """The asset as xarray's labelled arrays, each group a node; `bakery.from_xarray` makes an asset of it again.

        `asset.medium.to_xarray()` gives one group alone.  See `bakery.asset.labelled` for names, units and errors; UsageError
        where xarray is not installed.

        Examples
        --------
        >>> asset.to_xarray().to_netcdf("fog.nc")                                                   # doctest: +SKIP
        """
        return labelled.tree(self.tree)

    def __dir__(self):
        return [*super().__dir__(), *self._groups]

    def __repr__(self) -> str:
        lines = [f"asset {self.name!r}, wavelength {in_words(self.wavelength, self.wavelength.units)}, "
                 f"content {self.content_hash[:12]}"]
        lines += [f"  {name}{error_of(stage)}: {headline(self._groups[name])}" for name, stage in self.stages.items()]
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        rows = [(name, error_of(stage).strip(), headline(self._groups[name])) for name, stage in self.stages.items()]
        title = f"{self.name}, wavelength {in_words(self.wavelength, self.wavelength.units)}, content {self.content_hash[:12]}"
        return table(("stage", "error", "holds"), rows, 3, title) + first_picture(rendered(self.tree))
