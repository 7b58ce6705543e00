"""What lies under a layer: the `surface` of another asset, or of another recipe, as layers of the same wavelengths."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import replace
from types import SimpleNamespace
from typing import TYPE_CHECKING

import numpy as np

from bakery.errors import StageError
from bakery.grammar.text import show
from bakery.grammar.units import Wrong
from bakery.stages.declaration import Result
from bakery.store.tree import Group

if TYPE_CHECKING:
    from bakery.recipe.checker import Checker

_SAME = 1e-6  # of a wavelength


# ---- recipes


def check(checker: Checker, base: Mapping) -> None:
    """Just one of albedo, asset and recipe; what an asset or a recipe holds can lie under another layer."""
    kinds = [name for name in ("albedo", "asset", "recipe") if name in base]
    if len(kinds) != 1:
        checker.report_section(base, f"found {' and '.join(kinds) or 'none of them'}", "expected one of albedo, asset, recipe")
        return
    if "layer" in base and kinds == ["albedo"]:
        checker.report_section(base["layer"], "found layer beside albedo", "expected it with an asset or a recipe only")
    read = {"asset": _of_asset, "recipe": _of_recipe}.get(kinds[0])
    if read is not None and checker.wavelength is not None and checker.value(base, kinds[0]) is not None:
        try:
            read(checker, base[kinds[0]], checker.value(base, "layer") or 0)
        except Wrong as wrong:
            checker.report(base[kinds[0]], wrong.found, wrong.expected)


def _of_asset(checker: Checker, node, layer: int) -> None:
    """The layers of an asset file stand behind the key; its digest is that of what is taken of it."""
    key, name = node.place.key, checker.values[node.place.key]
    if name.endswith((".yaml", ".yml")):
        raise Wrong(f"found {show(name)}, a recipe", f"expected an asset (.h5), or recipe: {name}")
    root, file = checker.asset(node)
    groups = [root.members.get(part) for part in ("medium", "surface")]
    if not all(isinstance(group, Group) for group in groups):
        raise Wrong(f"found {show(name)}, which has no stage surface", "expected an asset baked with the section surface")
    rows = _picked(root["wavelength"].data, checker.wavelength, name)
    layers = of_tree(root, layer, name)
    checker.found[key] = tuple(layers[row] for row in rows)
    hashes = " ".join(str(group.attributes.get("content_hash", "")) for group in groups)
    checker.files.append(replace(file, sha256=hashlib.sha256(hashes.encode()).hexdigest()))


def _of_recipe(checker: Checker, node, layer: int) -> None:
    """The checked recipe stands behind the key; what it reads is read by this one too."""
    key, name = node.place.key, checker.values[node.place.key]
    if name.endswith(".h5"):
        raise Wrong(f"found {show(name)}, an asset", f"expected a recipe (.yaml), or asset: {name}")
    named = checker.recipe(node)
    if named is None:
        return
    recipe, file = named.recipe, named.file
    if recipe.surface is None:
        raise Wrong(f"found {show(name)}, which has no section surface", "expected one, surface: {} for an infinite layer")
    _picked(recipe.wavelength, checker.wavelength, name)
    count = 1 if recipe.surface.thickness == "infinite" else len(recipe.surface.thickness)
    if layer >= count:
        raise Wrong(f"found layer {layer} of {show(name)}, which has {count}", f"expected 0 to {count - 1}")
    _fit(name, 1.0 if recipe.surface.boundary == "none" else recipe.surface.boundary.index)
    checker.found[key] = named
    versions = [f"{stage.name} {stage.version}" for stage in named.stages]
    whole = hashlib.sha256(" ".join([file.sha256, *versions]).encode()).hexdigest()
    checker.files += [replace(file, sha256=whole), *(replace(part, key=f"{key}.{part.key}") for part in recipe.files)]


def check_under_facets(checker: Checker, base: Mapping, boundary: Mapping) -> None:
    """Under a rough boundary no air is below."""
    node = next((base[name] for name in ("asset", "recipe") if name in base), None)
    under = None if node is None else checker.found.get(node.place.key)
    if under is not None and _open_below(under):
        checker.report(boundary["roughness"], "found a rough boundary of layers over air",
                       "expected a base under them, an infinite layer, or roughness: 0")


def _open_below(under) -> bool:
    """Whether air is below what stands behind `base`."""
    from bakery.physics.surfaces.slab import Slab, free

    if isinstance(under, tuple):
        return isinstance(under[0], Slab) and free(under[0])
    surface = under.recipe.surface
    deeper = None if surface.base is None else surface.base.asset or surface.base.recipe
    return surface.base is None and surface.thickness != "infinite" if deeper is None else _open_below(deeper)


def _picked(held, wanted, name: str) -> list[int]:
    """Positions of the wavelengths that are wanted; `Wrong` where one is not held."""
    held = np.asarray(held, float)
    rows = [int(np.argmin(np.abs(held - um))) for um in wanted]
    missing = [f"{um:g}" for um, row in zip(wanted, rows, strict=True) if abs(held[row] - um) > _SAME * um]
    if missing:
        raise Wrong(f"found {show(name)} at {', '.join(f'{um:g}' for um in held[:8])}{' …' * (len(held) > 8)} um, without "
                    f"{', '.join(missing[:8])} um", "expected one that was baked at this recipe's wavelengths, or more")
    return rows


def _fit(name: str, index: float) -> None:
    """`Wrong` where something cannot lie under another layer."""
    if index < 1:
        raise Wrong(f"found {show(name)} with an index of {index:g}", "expected 1 or more of layers on each other")


# ---- layers


def of_tree(root: Group, layer: int, name: str) -> list:
    """Of each wavelength of an asset, its layer as it lies under another one: a `Slab`, or a `Reflector` of grains.

    Raises Wrong : no such layer, or one that cannot lie there
    """
    from bakery.physics.surfaces.corrected import Corrected
    from bakery.physics.surfaces.slab import reflector
    from bakery.stages.surface.view import solutions_of

    rows = solutions_of(root["surface"], root["medium"])
    if layer >= len(rows[0]):
        raise Wrong(f"found layer {layer} of {show(name)}, which has {len(rows[0])}", f"expected 0 to {len(rows[0]) - 1}")
    layers = []
    for row in rows:
        solution = row[layer]
        if isinstance(solution, Corrected):
            if solution.below is not None:
                raise Wrong(f"found {show(name)}, a layer of grains of a thickness over air",
                            "expected one without end or on a base, or method: medium in its recipe")
            layers.append(reflector(solution.reflection))
            continue
        slab = solution.slab
        _fit(name, slab.index)
        layers.append(slab)
    return layers


def layers_of(under, wavelength, layer: int, context) -> list:
    """The same of what stands behind `base`, at the recipe's wavelengths.

    under : layers, as `_of_asset` found them, or a recipe (`recipe.checker.Named`), whose stages are run here
    """
    if isinstance(under, tuple):
        return list(under)
    rows = _picked(under.recipe.wavelength, wavelength, under.recipe.path.name)
    try:
        layers = of_tree(_baked(under.recipe, under.stages, context), layer, under.recipe.path.name)
    except Wrong as wrong:
        raise StageError(f"{wrong.found}; {wrong.expected}") from None
    return [layers[row] for row in rows]


def _baked(recipe, stages, context) -> Group:
    """The groups `medium` and `surface` of a recipe, and what they need."""
    needed, groups = {"surface"}, {}
    for stage in stages[::-1]:
        needed |= set(stage.needs) if stage.name in needed else set()
    for stage in stages:
        if stage.name in needed:
            inner = SimpleNamespace(tolerance=stage.tolerance(recipe), seed=recipe.seed, map=context.map, report=lambda *_: None)
            result: Result = stage.compute(stage.inputs(recipe, groups), inner)
            if result.missed:
                raise StageError(f"{recipe.path.name}: {stage.name}: {result.missed[0]}")
            groups[stage.name] = Group(result.members, {})
    return Group(groups, {})
