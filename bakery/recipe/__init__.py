"""YAML text to checked values, each with its line.

`load` is the entry point: text -> tree (`grammar.text`) -> kinds of values (`schema.py`, `grammar.fields`, `grammar.units`) ->
what holds between keys (`checker.py`) -> `Recipe` (`model.py`); once for each value of a key that is swept (`sweep.py`).
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bakery.recipe.model import Recipe

__all__ = ["json_schema", "load"]


def load(path: str | os.PathLike, overrides: Mapping[str, str] | None = None, *, keep_going: bool = False) -> Recipe:
    """Read and check a recipe.

    Parameters
    ----------
    path : of the recipe, a regular file of at most 1 MiB
    overrides : dotted key -> value as YAML text, such as `{"particles.number_density": "2e8 /m^3"}`; an item of a list is
        `components[0]`, or `components.droplets` if it has a name
    keep_going : of a sweep, points that are wrong are left to their turn, where others are not

    Returns
    -------
    Recipe

    Raises
    ------
    UsageError : there is no such regular file
    RecipeError : with every problem of the recipe, of the overrides and of the tables that it names

    Examples
    --------
    >>> recipe = load("recipes/fog.yaml", {"particles.number_density": "2e8 /m^3"})
    >>> recipe.particles.number_density
    200000000.0
    """
    from bakery.recipe.build import check
    from bakery.recipe.sweep import checked, sweeps

    source, tree, edited, problems = _parsed(path, overrides or {})
    path = path if isinstance(path, Path) else Path(path)
    if sweeps(tree):
        return checked(path, source, tree, edited, problems, keep_going)
    return check(path, source, tree, edited, problems)


def _parsed(path: str | os.PathLike, overrides: Mapping[str, str]):
    """Source and tree of a recipe, its text with the overrides in it, and their problems."""
    from bakery.errors import Problem, RecipeError
    from bakery.grammar import text
    from bakery.grammar.files import source_of
    from bakery.grammar.overrides import apply

    source = source_of(path)
    tree, label = text.parse(source), source.label
    if isinstance(tree.root, text.Mapping) and "bakery_scene" in tree.root and "bakery" not in tree.root:
        # its keys would be so many unknown ones
        raise RecipeError([Problem(label, None, None, "", "is a scene", f"`bake render {label}` renders it")])
    return source, tree, *apply(source, tree, overrides)


def json_schema() -> dict:
    """The JSON Schema (draft 2020-12) of recipes, for editors."""
    from bakery.recipe.jsonschema import json_schema as schema

    return schema()
