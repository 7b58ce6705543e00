"""A tree that passed all checks becomes a `Recipe`; else all problems are raised at once."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from pydantic import BaseModel, ValidationError

from bakery.errors import Problem, RecipeError
from bakery.grammar.fields import describe
from bakery.grammar.files import Folder
from bakery.grammar.problems import distinct, places, translate
from bakery.grammar.text import Mapping, Source, Tree
from bakery.recipe import grain_schema, model, schema
from bakery.recipe.checks import Checker

# What the default methods reach: tables of forward lobes that the solver just resolves (g = 0.9: 0.5 %), and the half space of
# narrow beams (fog: 1.4 %).  A default below that would miss itself.
_REACHED_BY_TABLES, _REACHED_BY_BEAMS = 0.01, 0.03

MAX_PROBLEMS = 200


def check(path: Path, source: Source, tree: Tree, text: str, problems: list[Problem]) -> model.Recipe:
    """The recipe of a tree; `text` is its text with overrides applied, `problems` what is known to be wrong."""
    problems = tree.problems + problems
    if not isinstance(tree.root, Mapping):
        if tree.root is None or not tree.root.broken:
            found = "nothing" if tree.root is None else describe(tree.root)
            problems.append(
                source.problem(
                    None if tree.root is None else tree.root.place.begin,
                    "",
                    f"found {found}",
                    "expected `key: value` lines; a recipe starts with `bakery: 1`",
                )
            )
        raise RecipeError(problems)
    values: dict = {}
    try:
        parsed = schema.RecipeFile.model_validate(tree.root, context=values)
    except ValidationError as error:
        parsed = None
        problems += (problem for one in error.errors(include_url=False) for problem in translate(one))
    checker = Checker(tree.root, values, Folder(path.parent))
    checker.run()
    problems = distinct(problems + checker.problems)
    if problems:
        if len(problems) > MAX_PROBLEMS:
            left = len(problems) - MAX_PROBLEMS
            problems = sorted(problems, key=lambda p: p.line or 0)[:MAX_PROBLEMS]
            problems.append(
                Problem(problems[-1].file, problems[-1].line, None, "", f"{left:,} more problems follow", "correct these first")
            )
        raise RecipeError(problems)
    return _recipe(path, text, tree.root, parsed, checker)


# ---- values


def _recipe(path: Path, text: str, root: Mapping, parsed: schema.RecipeFile, checker: Checker) -> model.Recipe:
    where = {place.key: str(place) for place in places(root)}
    phase = parsed.phase or schema.SingleScattering()
    leaves = dict(_leaves("", parsed, len(checker.wavelength)))
    if parsed.particles:
        leaves |= dict(_leaves("phase", phase, len(checker.wavelength)))
    scatterometer, effective = parsed.scatterometer or grain_schema.Scatterometer(), parsed.effective_medium
    if scatterometer.tolerance is None:
        scatterometer = scatterometer.model_copy(update={"tolerance": parsed.tolerance / 2})
    effective = effective or grain_schema.EffectiveMedium()
    if parsed.grains:
        leaves |= dict(_leaves("scatterometer", scatterometer, 1)) | dict(_leaves("effective_medium", effective, 1))
    multiple = parsed.multiple_scattering
    if multiple:
        aim = multiple.tolerance or max(0.3 * parsed.tolerance, 1e-4)  # less than has to be met, as it costs little
        multiple = multiple.model_copy(update={"tolerance": multiple.tolerance or max(parsed.tolerance, _REACHED_BY_TABLES)})
        leaves |= dict(_leaves("multiple_scattering", multiple, 1)) | {"multiple_scattering.aim": aim}
    beam = parsed.beam
    if beam:
        beam = beam.model_copy(update={"tolerance": beam.tolerance or max(parsed.tolerance, _REACHED_BY_BEAMS)})
        leaves |= dict(_leaves("beam", beam, 1))
    packing = parsed.packing and _packing(parsed.packing, parsed.seed)
    if packing:
        leaves["packing.seed"] = packing.seed
    return model.Recipe(
        path=path,
        name=parsed.name,
        description=parsed.description,
        text=text,
        seed=parsed.seed,
        tolerance=parsed.tolerance,
        measure=parsed.measure,
        wavelength=tuple(checker.wavelength),
        particles=parsed.particles and _particles(parsed.particles, checker),
        phase=_single_scattering(phase),
        medium=parsed.medium and _medium(parsed.medium, checker),
        packing=packing,
        grains=parsed.grains and _grains(parsed.grains, checker),
        scatterometer=model.Scatterometer(**_options(scatterometer)),
        effective_medium=model.EffectiveMedium(**_options(effective)),
        multiple_scattering=multiple and model.MultipleScattering(
            **_options(multiple) | {"sources": tuple(multiple.sources), "method": multiple.method, "aim": aim}),
        beam=beam and model.Beam(**_options(beam)),
        leaves=leaves,
        files=tuple(checker.files),
        places=where,
        warnings=tuple(checker.warnings),
    )


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


def _options(section: BaseModel) -> dict:
    """The values of a section, None where they are left to the stage."""
    return {name: None if (value := getattr(section, name)) == "auto" else value for name in type(section).model_fields}


def _single_scattering(section: schema.SingleScattering) -> model.SingleScattering:
    # auto as a method is a choice of its own
    return model.SingleScattering(
        **_options(section) | {"method": section.method, "edge": None if section.edge == "none" else section.edge}
    )


def _particles(section: schema.Particles, checker: Checker) -> model.Particles:
    components = tuple(
        model.Component(
            part.name,
            _index(checker, f"particles.components[{i}].material"),
            part.fraction,
            _size(part.size, f"particles.components[{i}].size", checker),
        )
        for i, part in enumerate(section.components)
    )
    return model.Particles(_index(checker, "particles.host"), section.number_density, section.volume_fraction, components)


def _index(checker: Checker, key: str) -> model.Index:
    found = checker.indices[key]
    return model.Index(found.name, _frozen(found.n), _frozen(found.k))


def _size(size, key: str, checker: Checker) -> model.Size:
    values = {name: getattr(size, name, None) for name in ("radius", "sigma", "variance", "min", "max")}
    table = tuple(_frozen(column) for column in checker.columns[f"{key}.file"]) if size.distribution == "table" else None
    of = tuple((part.share, _size(part, f"{key}.of[{i}]", checker)) for i, part in enumerate(getattr(size, "of", ())))
    return model.Size(size.distribution, **values, table=table, of=of)


def _medium(section: schema.Medium, checker: Checker) -> model.Medium:
    get = checker.columns.get
    if section.mean_free_path is not None:
        sigma_t, albedo = 1e6 / get("medium.mean_free_path"), get("medium.albedo")  # um to 1/m
    else:
        sigma_t = get("medium.sigma_s") + get("medium.sigma_a")
        albedo = get("medium.sigma_s") / sigma_t
    phase = section.phase
    g = get("medium.phase.g")
    table = tuple(_frozen(column) for column in get("medium.phase.file")) if phase.type == "table" else None
    return model.Medium(
        _frozen(sigma_t),
        _frozen(albedo),
        model.Phase(phase.type, None if g is None else _frozen(g), getattr(phase, "spread", None), table),
    )


def _grains(section: grain_schema.Grains, checker: Checker) -> model.Grains:
    components = tuple(
        _grain(part, f"grains.components[{i}]", checker) for i, part in enumerate(section.components)
    )
    return model.Grains(section.radius, _index(checker, "grains.host"), components)


def _grain(part: grain_schema.Grain, key: str, checker: Checker) -> model.Grain:
    surface = part.surface
    opaque = surface.type == "diffuse"
    found = model.GrainSurface(
        surface.type,
        None if opaque else _index(checker, f"{key}.surface.material"),
        0.0 if opaque else surface.roughness,
        _frozen(checker.columns[f"{key}.surface.reflectance"]) if opaque else None,
    )
    if part.interior is None:
        absorption = np.zeros(len(checker.wavelength))
    elif part.interior.material is None:
        absorption = checker.columns[f"{key}.interior.absorption"]
    else:  # wavelengths are in um
        absorption = 4e6 * np.pi * checker.indices[f"{key}.interior.material"].k / np.array(checker.wavelength)
    return model.Grain(part.name, part.weight, _shape(part.shape, key, checker), found, _frozen(absorption))


def _shape(shape, key: str, checker: Checker) -> dict:
    """What `grains.shapes.build` takes."""
    if shape.type == "mesh":
        data, kind = checker.meshes[f"{key}.shape.file"]
        return {"type": "mesh", "data": data, "kind": kind}
    values = {name: getattr(shape, name) for name in type(shape).model_fields}
    return {name: tuple(v) if isinstance(v, list) else math.inf if v == "inf" else v for name, v in values.items()}


def _packing(section: schema.Packing, seed: int) -> model.Packing:
    radii = section.radii
    if radii == "equal":
        law = model.Radii("equal")
    elif isinstance(radii, list):
        law = model.Radii("list", tuple((part.share, part.radius) for part in radii))
    else:
        law = model.Radii("lognormal", sigma=radii.sigma)
    growth, equilibration = (None if value == "auto" else value for value in (section.growth, section.equilibration))
    return model.Packing(tuple(section.fraction), section.count, tuple(section.cell), law, growth, equilibration,
                         seed if section.seed is None else section.seed)


def _frozen(array: np.ndarray) -> np.ndarray:
    array = np.array(array, dtype=float)
    array.flags.writeable = False
    return array
