"""A tree that passed all checks becomes a `Recipe`; else all problems are raised at once."""

import os
from collections.abc import Iterator
from pathlib import Path

from pydantic import BaseModel

from bakery.errors import Problem, RecipeError
from bakery.grammar.files import Folder, source_of
from bakery.grammar.problems import distinct, no_keys, places, validated
from bakery.grammar.text import Mapping, Source, Tree, parse, show
from bakery.grammar.units import Wrong
from bakery.grammar.values import Values, resolved
from bakery.recipe import schema
from bakery.recipe.checker import Checker
from bakery.recipe.model import Recipe

MAX_PROBLEMS = 200


def check(path: Path, source: Source, tree: Tree, text: str, problems: list[Problem], within: tuple[str, ...] = ()) -> Recipe:
    """The recipe of a tree; `text` is its text with overrides applied, `problems` what is known to be wrong.

    within : real paths of the recipes that name this one
    """
    problems = tree.problems + problems
    if not isinstance(tree.root, Mapping):
        if tree.root is None or not tree.root.broken:
            problems.append(no_keys(source, tree.root, "a recipe starts with `bakery: 1`"))
        raise RecipeError(problems)
    parsed, values, wrong = validated(schema.recipe_file(), tree.root)
    problems += wrong
    checker = Checker(tree.root, values, Folder(path.parent), schema.sections(),
                      read=lambda file: _named(file, (*within, os.path.realpath(path))))
    checker.run()
    problems = distinct(problems + checker.problems)
    if problems:
        if len(problems) > MAX_PROBLEMS:
            hidden = len(problems) - MAX_PROBLEMS
            problems = sorted(problems, key=lambda p: p.line or 0)[:MAX_PROBLEMS]
            problems.append(Problem(problems[-1].file, problems[-1].line, None, "", f"{hidden:,} more problems follow",
                                    "correct these first"))
        raise RecipeError(problems)
    return _recipe(path, text, tree.root, parsed, checker)


def _named(path: Path, within: tuple[str, ...]) -> Recipe:
    """The recipe of a file that another one names; `Wrong` where that goes round, or it is many."""
    if os.path.realpath(path) in within:
        raise Wrong(f"found {show(path.name)}, which leads back to this recipe", "expected another recipe")
    source = source_of(path)
    tree = parse(source)
    if isinstance(tree.root, Mapping) and isinstance(tree.root.get("sweep"), Mapping):
        raise Wrong(f"found {show(path.name)}, which sweeps keys", "expected a recipe of one asset")
    return check(path, source, tree, source.text, [], within)


# ---- values


def _recipe(path: Path, text: str, root: Mapping, parsed: schema.Common, checker: Checker) -> Recipe:
    count = len(checker.wavelength)
    leaves = dict(_leaves("", parsed, count))
    sections = {}
    for section in schema.sections():
        parsed_section = getattr(parsed, section.name)
        if parsed_section is None and section.beside:
            parsed_section = section.model()
        if parsed_section is None:
            sections[section.name] = None
            continue
        parsed_section = section.completed(parsed_section, parsed)
        if not section.beside or getattr(parsed, section.beside) is not None:
            leaves |= dict(_leaves(section.name, parsed_section, count))
        sections[section.name] = Values(resolved(parsed_section, section.name, checker.found))
    return Recipe(
        path=path, name=parsed.name, description=parsed.description, text=text, seed=parsed.seed, tolerance=parsed.tolerance,
        measure=parsed.measure, wavelength=tuple(checker.wavelength), sections=sections, leaves=leaves,
        files=tuple(checker.files), places={key.key: str(key) for key in places(root)}, warnings=tuple(checker.warnings))


def _leaves(key: str, value, wavelengths: int) -> Iterator[tuple[str, str | int | float | bool]]:
    """Every value below a key; what is one value for all wavelengths is written out for each."""
    if isinstance(value, BaseModel):
        for name in type(value).model_fields:
            yield from _leaves(f"{key}.{name}" if key else name, getattr(value, name), wavelengths)
    elif isinstance(value, (tuple, list)):
        spread = len(value) == 1 and isinstance(value[0], float) and key not in ("wavelengths", "packing.fraction")
        for i, item in enumerate(value * wavelengths if spread else value):
            yield from _leaves(f"{key}[{i}]", item, wavelengths)
    elif value is not None:
        yield key, value
