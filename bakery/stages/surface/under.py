"""What lies under a layer: the `surface` of another asset, or of another recipe, as layers of the same wavelengths."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterable, Mapping
from dataclasses import replace
from types import SimpleNamespace
from typing import TYPE_CHECKING

import numpy as np

from bakery.errors import AssetError, StageError, StoreError
from bakery.grammar import netcdf
from bakery.grammar.text import show
from bakery.grammar.units import Wrong
from bakery.stages.declaration import ANY, Output, Result
from bakery.store.tree import Group

if TYPE_CHECKING:
    from bakery.recipe.checker import Checker

_SAME = 1e-6  # of a wavelength
INFINITE_DEPTH = -1.0  # how an infinite optical depth is stored
OUTPUTS = (
    Output("under_index", "(J,)", "1", "refractive index of each layer under this one, from the top, over that of the air",
           optional=True),
    Output("under_depth", "(L, J)", "1", "optical depth of each; -1: infinite", optional=True, within=(-1, math.inf)),
    Output("under_albedo", "(L, J)", "1", "single-scattering albedo of each", optional=True, within=(0, 1)),
    Output("under_peak", "(L, J)", "1", "share of the scattered light of each in a forward peak that the solver leaves out",
           optional=True, within=(0, 1)),
    Output("under_theta", "(Q,)", "rad", "angles of their phase functions, 0: forward", optional=True, within=(0, math.pi)),
    Output("under_phase", "(L, J, Q)", "1/sr", "their phase functions, linear in the cosine in between", optional=True),
    Output("under_reflected", "(L, O, G)", "1", "Fourier orders of what lies under all of them and is counted among grains, "
           "times the sum of both cosines and, of odd orders, over both sines: at Gauss nodes of the root of the cosine, row by "
           "row of an upper triangle", optional=True, within=ANY),
    Output("mirrored", "(L, T, N)", "1", "share of the light from each direction that boundaries between layers mirror",
           optional=True, within=(0, 1)),
)
NAMES = tuple(output.path for output in OUTPUTS if output.path not in ("under_reflected", "mirrored"))


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
    from bakery.stages import conform
    from bakery.store.read import parse

    key, name = node.place.key, checker.values[node.place.key]
    if name.endswith((".yaml", ".yml")):
        raise Wrong(f"found {show(name)}, a recipe", f"expected an asset (.h5), or recipe: {name}")
    data, file = checker.folder.read(key, name, netcdf.BYTES, "file")
    try:
        root = parse(name, data)
        conform.check(name, root)
    except (AssetError, StoreError) as fault:
        raise Wrong(f"found a file that is no whole asset ({fault})", "expected what `bake` wrote") from None
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
    from bakery.stages import all_stages

    key, name = node.place.key, checker.values[node.place.key]
    if name.endswith(".h5"):
        raise Wrong(f"found {show(name)}, an asset", f"expected a recipe (.yaml), or asset: {name}")
    recipe, file = checker.recipe(node)
    if recipe is None:
        return
    if recipe.surface is None:
        raise Wrong(f"found {show(name)}, which has no section surface", "expected one, surface: {} for an infinite layer")
    _picked(recipe.wavelength, checker.wavelength, name)
    count = 1 if recipe.surface.thickness == "infinite" else len(recipe.surface.thickness)
    if layer >= count:
        raise Wrong(f"found layer {layer} of {show(name)}, which has {count}", f"expected 0 to {count - 1}")
    boundary, base = recipe.surface.boundary, recipe.surface.base
    _fit(name, 0.0 if boundary == "none" else boundary.roughness, 1.0 if boundary == "none" else boundary.index,
         base is None and recipe.surface.thickness != "infinite")
    checker.found[key] = recipe
    versions = [f"{stage.name} {stage.version}" for stage in all_stages() if stage.applies(recipe)]
    whole = hashlib.sha256(" ".join([file.sha256, *versions]).encode()).hexdigest()
    checker.files += [replace(file, sha256=whole), *(replace(part, key=f"{key}.{part.key}") for part in recipe.files)]


def _picked(held, wanted, name: str) -> list[int]:
    """Positions of the wavelengths that are wanted; `Wrong` where one is not held."""
    held = np.asarray(held, float)
    rows = [int(np.argmin(np.abs(held - um))) for um in wanted]
    missing = [f"{um:g}" for um, row in zip(wanted, rows, strict=True) if abs(held[row] - um) > _SAME * um]
    if missing:
        raise Wrong(f"found {show(name)} at {', '.join(f'{um:g}' for um in held[:8])}{' …' * (len(held) > 8)} um, without "
                    f"{', '.join(missing[:8])} um", "expected one that was baked at this recipe's wavelengths, or more")
    return rows


def _fit(name: str, roughness: float, index: float, free: bool) -> None:
    """`Wrong` where something cannot lie under another layer."""
    if roughness > 0 and index != 1:
        raise Wrong(f"found {show(name)} under facets (roughness {roughness:g})", "expected a smooth boundary, or none, between "
                    "layers")
    if index < 1:
        raise Wrong(f"found {show(name)} with an index of {index:g}", "expected 1 or more of layers on each other")
    if free:
        raise Wrong(f"found {show(name)}, a layer on nothing", "expected one that is infinite, or has a base")


# ---- layers


def of_tree(root: Group, layer: int, name: str) -> list:
    """Of each wavelength of an asset, its layer as it lies under another one: a `Slab`, or a `Reflector` of grains.

    Raises
    ------
    Wrong : no such layer, or one that cannot lie there
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
            layers.append(reflector(solution.reflection))
            continue
        slab = solution.slab
        _fit(name, slab.roughness, slab.index, slab.depth < math.inf and slab.base is None and slab.under is None)
        layers.append(slab)
    return layers


def layers_of(under, wavelength, layer: int, context) -> list:
    """The same of what stands behind `base`, at the recipe's wavelengths.

    Parameters
    ----------
    under : layers, as `_of_asset` found them, or a recipe, whose stages are run here
    """
    if isinstance(under, tuple):
        return list(under)
    rows = _picked(under.wavelength, wavelength, under.path.name)
    try:
        layers = of_tree(_baked(under, context), layer, under.path.name)
    except Wrong as wrong:
        raise StageError(f"{wrong.found}; {wrong.expected}") from None
    return [layers[row] for row in rows]


def _baked(recipe, context) -> Group:
    """The groups `medium` and `surface` of a recipe, and what they need."""
    from bakery.stages import all_stages

    stages = [stage for stage in all_stages() if stage.applies(recipe)]
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


# ---- arrays


def stored(slabs: list, solutions: list, shape: tuple[int, int]) -> dict:
    """Arrays of what lies under layers, T thicknesses of each of L wavelengths."""
    from bakery.physics.surfaces.slab import Reflector
    from bakery.physics.surfaces.stack import layers
    from bakery.stages.surface.view import packed

    firsts = range(0, len(slabs), shape[1])
    stacks, bottoms = zip(*(layers(slabs[first]) for first in firsts), strict=True)
    below = [stack[1:] for stack in stacks]
    theta = np.unique(np.concatenate([[0.0, math.pi], *(part.theta for stack in below for part in stack)]))
    values = {"under_index": np.array([part.index for part in below[0]]),
              "under_albedo": np.array([[part.albedo for part in stack] for stack in below]),
              "under_depth": np.array([[INFINITE_DEPTH if part.depth == math.inf else part.depth for part in stack]
                                       for stack in below]),
              "under_peak": np.array([[cut.share for cut in solutions[first].cuts[1:]] for first in firsts]),
              "under_theta": theta, "under_phase": np.array([[_resampled(part, theta) for part in stack] for stack in below])}
    values = {name: value.reshape(len(below), 0, *value.shape[2:]) if not below[0] and name != "under_index" else value
              for name, value in values.items() if below[0]}
    if isinstance(bottoms[0], Reflector):
        values["under_reflected"] = np.stack([packed(bottom.orders, len(bottom.orders)) for bottom in bottoms]).astype(np.float32)
    elif bottoms[0] is not None:
        values["base"] = np.array([float(bottom) for bottom in bottoms])
    return values | {"mirrored": np.array([solution.mirrored for solution in solutions]).clip(0, 1).reshape(*shape, -1)}


def _resampled(part, theta):
    """A phase function at more angles: linear in the cosine, as it is."""
    from bakery.physics.medium.phase import phase_at

    return phase_at(part.theta, part.phase, theta)


def rebuilt(group: Group, k: int):
    """What lies under a layer at wavelength number k, from the arrays: a `Slab` or a `Reflector`; None if nothing is stored."""
    from bakery.physics.surfaces.slab import Reflector, Slab
    from bakery.stages.surface.view import unpacked

    bottom, base = None, float(group["base"].data[k]) if "base" in group.members else None
    if "under_reflected" in group.members:
        triangles = np.asarray(group["under_reflected"].data[k], float)
        bottom = Reflector(unpacked(triangles, int((math.sqrt(1 + 8 * triangles.shape[1]) - 1) / 2)))
    if "under_index" not in group.members:
        return bottom
    theta, index = np.asarray(group["under_theta"].data, float), group["under_index"].data
    for j in range(len(index))[::-1]:
        depth, albedo, last = float(group["under_depth"].data[k, j]), float(group["under_albedo"].data[k, j]), bottom is None
        bottom = Slab(theta, np.asarray(group["under_phase"].data[k, j], float), albedo,
                      math.inf if depth == INFINITE_DEPTH else depth, float(index[j]), base if last else None, 0.0, bottom)
    return bottom


def sound(group: Group) -> Iterable[str]:
    """Whether all arrays of layers are there, and an infinite one is the last."""
    several = [name for name in NAMES if name in group.members]
    if several and len(several) < len(NAMES):
        yield "of " + ", ".join(NAMES) + f" there is only {', '.join(several)}"
    elif several:
        depth, theta = group["under_depth"].data, group["under_theta"].data
        if ((depth < 0) & (depth != INFINITE_DEPTH)).any() or (depth[:, :-1] < 0).any():
            yield "under_depth is below 0 where no infinite layer ends the stack"
        if theta[0] != 0 or abs(theta[-1] - math.pi) > 1e-9 or not (np.diff(theta) > 0).all():
            yield "under_theta does not ascend from 0 to pi"
        if (group["under_index"].data < 1).any():
            yield "under_index is below 1"
    if "under_reflected" in group.members:
        count = group["under_reflected"].data.shape[-1]
        if int((math.sqrt(1 + 8 * count) - 1) / 2) * int((math.sqrt(1 + 8 * count) + 1) / 2) != 2 * count:
            yield "under_reflected does not hold one value a pair of directions"
