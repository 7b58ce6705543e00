"""YAML text to checked values, each with its line.

`load` is the entry point: text -> tree (`grammar.text`) -> kinds of values (`schema.py`, `grammar.fields`, `grammar.units`) ->
what holds between keys (`checker.py`) -> `Recipe` (`model.py`).
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bakery.recipe.model import Recipe

__all__ = ["json_schema", "load"]


def load(path: str | os.PathLike, overrides: Mapping[str, str] | None = None) -> Recipe:
    """Read and check a recipe.

    Parameters
    ----------
    path : of the recipe, a regular file of at most 1 MiB
    overrides : dotted key -> value as YAML text, such as `{"particles.number_density": "2e8 /m^3"}`; an item of a list is
        `components[0]`, or `components.droplets` if it has a name

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
    from bakery.grammar import text
    from bakery.grammar.files import read_recipe
    from bakery.grammar.overrides import apply
    from bakery.recipe.build import check

    label = text.label_of(path)
    source = text.Source(label, text.decode(read_recipe(path), label))
    tree = text.parse(source)
    return check(Path(path), source, tree, *apply(source, tree, overrides or {}))


def json_schema() -> dict:
    """The JSON Schema (draft 2020-12) of recipes, for editors."""
    from bakery.recipe.jsonschema import json_schema as schema

    return schema()
