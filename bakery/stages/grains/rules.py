"""What holds in every group `grains`: what readers count on, and what `verify` asks besides."""

import json
import math
from collections.abc import Iterable

import numpy as np

from bakery.physics.shapes import solid
from bakery.stages import rules
from bakery.stages.grains.outputs import SCALARS
from bakery.store.tree import Dataset, Group, read_text

# type of a surface -> its values, one a wavelength
OF_SURFACES = {"dielectric": ("index",), "diffuse": ("reflectance",), "conductor": ("n", "k")}


def sound(group: Group) -> Iterable[str]:
    """Whether angles ascend, and every grain is a solid in the unit sphere with a shape and a surface that can be read."""
    yield from rules.angles(group["theta"].data)
    if not group.groups:
        yield "holds no grain"
    for name, part in group.groups.items():
        faults = (*solid.faults(part["vertices"].data, part["faces"].data), *_texts(part, len(part["interior"].data)))
        yield from (f"{name}: {fault}" for fault in faults)


def _texts(part: Group, wavelengths: int) -> Iterable[str]:
    for name in ("shape", "surface"):
        try:
            decoded = json.loads(read_text(part[name]))
        except (ValueError, RecursionError):
            decoded = None
        if not isinstance(decoded, dict):
            yield f"{name} is no JSON object"
        elif name == "surface":
            yield from _surface(decoded, wavelengths)
        elif not isinstance(decoded.get("type"), str):
            yield "shape has no type"


def _surface(surface: dict, wavelengths: int) -> Iterable[str]:
    """Whether a stored surface is of a known type, with numbers, one a wavelength."""
    keys = OF_SURFACES.get(surface["type"]) if isinstance(surface.get("type"), str) else None
    if keys is None:
        yield f"surface: found type {surface.get('type')!r}; {', '.join(OF_SURFACES)} would do"
        return
    for key in keys:
        values = surface.get(key)
        if not isinstance(values, list) or len(values) != wavelengths or not all(_is_number(v) and v >= 0 for v in values):
            yield f"surface/{key}: {wavelengths} numbers are needed, one a wavelength"
    if not _is_number(surface.get("roughness", 0.0)):
        yield "surface/roughness: a number is needed"


def _is_number(value) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def check(group: Group) -> Iterable[str]:
    """Broken rules of a `grains` group, in words."""
    v = {name: np.asarray(member.data, float) for name, member in group.datasets.items()}
    if not (v["radius"] > 0).all() or not (v["radius_share"] > 0).all() or abs(v["radius_share"].sum() - 1) > 1e-9:
        yield "radius is not above 0, or radius_share does not add up to 1"
    parts = group.groups
    for name, part in parts.items():
        yield from (f"{name}: {fault}" for fault in _check_component(part, v["theta"]))
    total = math.fsum(float(part["weight"].data[0]) for part in parts.values())
    if abs(total - 1) > 1e-6:
        yield f"weights add up to {total:.9g}, not 1"


def _check_component(part: Group, theta) -> Iterable[str]:
    v = {path: np.asarray(member.data, float) for path, member in part.walk()
         if isinstance(member, Dataset) and path not in ("shape", "surface")}
    for path, value in v.items():
        name = path.rpartition("/")[2]
        if name == "phase":
            yield from rules.phase_function(theta, value)
        if name == "mean_square" and (value > 4 + 1e-9).any():
            yield f"{path} above 4"
        if name in ("lambda_s", "lambda_o") and (above := path.removesuffix(name)) + "mean_square" in v \
                and (value**2 > v[above + "mean_square"] * (1 + 1e-6) + 1e-12).any():
            yield f"{path} is longer than the root of mean_square"
    beta = v["hit_probability"][0]
    # chords of a sphere have the mean 4/3, whatever the grain; six standard errors, and rounding
    mean = (1 - beta) * v["lambda_delta"][0] + beta * v["chord"][0]
    spread = math.hypot(*(float(v[name + "_error"][0]) for name in SCALARS))
    if abs(mean - 4 / 3) > 6 * spread + 1e-3 / math.sqrt(max(v["paths"][0], 1e6) / 1e6):
        yield f"chords of the bounding sphere have the mean {mean:.6g}, not 4/3"
