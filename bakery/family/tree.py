"""What the file of a family holds, and the contract that every reader of one relies on.

The group `family` carries the attributes of a stage's group, so that hashes, `bake inspect` and what misses its tolerance are as
of any other; docs/asset-format.md describes it.
"""

from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from bakery.family.axes import Axis, Swept
from bakery.physics.medium import phase
from bakery.physics.medium.between import METHODS, Optics, Tables
from bakery.stages.conform import FAMILY, LARGEST
from bakery.stages.rules import angles
from bakery.store.tree import Dataset, Group

VERSION = 1
MEASURE = ("largest error of interpolated media half-way between points, summed over the axes: relative of sigma_t and sigma_s, "
           "absolute of albedo and g, and of the phase function {}; over 0.8, for places that are no middles")
POINTWISE = "relative at any angle, beyond the stated error of the member"
INTEGRATED = "the integral of the error over the sphere"
_ATTRIBUTES = {"tolerance": float, "member_tolerance": float, "medium_version": int, "error_measure": str, "input_hash": str}
_UNITS = ("m", "1/m^3", "1/m", "rad", "1", "kg/m^3", "m^3/m^3")
_MEASURED = ("error", "measured")  # of the members of an axis; the others are values of its keys
_PER_WAVELENGTH = {"sigma_t": ("1/m", "extinction coefficient"), "sigma_s": ("1/m", "scattering coefficient"),
                   "sigma_a": ("1/m", "absorption coefficient"), "albedo": ("1", "single-scattering albedo"),
                   "g": ("1", "mean cosine of the phase function")}


class Member(NamedTuple):
    """One point: its file, relative to the family's, the content hash of the asset in it, the error of its medium; or the reason
    why there is none."""

    file: str
    content_hash: str
    achieved: float
    reason: str = ""


def tree_of(axes: Sequence[Axis], values: Sequence[Sequence[float]], tables: Tables, members: Sequence[Member],
            errors: Sequence[np.ndarray | None], attributes: Mapping) -> Group:
    """The group `family`.

    values : of the points on each axis, in SI units; `tables` holds what they are interpolated in
    members : of all points, the last axis fastest
    errors : between the points of each axis, None where nothing was measured
    """
    shape = tuple(map(len, values))
    groups = {axis.first.name: _axis(order, axis, at, error)
              for order, (axis, at, error) in enumerate(zip(axes, values, errors, strict=True))}
    sigma_t = tables.sigma_s + tables.sigma_a
    figures = {"sigma_t": sigma_t, "sigma_s": tables.sigma_s, "sigma_a": tables.sigma_a,
               "albedo": np.divide(tables.sigma_s, sigma_t, out=np.zeros_like(sigma_t), where=sigma_t > 0),
               "g": np.where(tables.missing[..., None], 0.0, _of_points(partial(phase.mean_cosine, tables.theta), tables.phase))}
    group = {"axes": Group(groups), "members": _members(members, shape)}
    group |= {name: Dataset(figures[name], units, f"{description} at the points, the axes in their order, then wavelengths")
              for name, (units, description) in _PER_WAVELENGTH.items()}
    group["theta"] = Dataset(tables.theta, "rad", "angle between the directions of travel, common to all points")
    group["phase"] = Dataset(tables.phase, "1/sr", "phase function, linear in cos theta between the angles, integral 1")
    if tables.ratios.shape[-2]:
        group["ratios"] = Dataset(tables.ratios, "1", "Mueller elements s12, s33, s34 over the phase function")
    return Group(group, {"stage": FAMILY, "stage_version": VERSION, **attributes})


def _axis(order: int, axis: Axis, values: Sequence[float], error: np.ndarray | None) -> Group:
    members = {}
    for key in axis.keys:
        at = np.array([key.between(axis.first, value) for value in values])
        name = "value" if key is axis.first else key.name
        members[name] = Dataset(at, key.units if key.units[0] != "/" else f"1{key.units}", f"recipe key {key.key}")
    if error is not None:
        finite = np.isfinite(error)
        members["error"] = Dataset(np.where(finite, error, 0.0), "1", "error of the interpolation half-way to the next point")
        members["measured"] = Dataset(finite, "1", "whether that is known; not where a point failed")
    return Group(members, {"order": order, "scale": "log" if axis.first.logarithmic else "linear"})


def _members(members: Sequence[Member], shape: tuple[int, ...]) -> Group:
    columns = zip(*members, strict=True)
    names = {"file": "path of the asset, from the family's folder", "content_hash": "content hash of the asset",
             "achieved": "achieved_error of its medium", "reason": "why there is no asset; empty where there is"}
    stored = {}
    for (name, description), column in zip(names.items(), columns, strict=True):
        data = np.array([value.encode() if isinstance(value, str) else value for value in column])
        stored[name] = Dataset(data.reshape(shape), "1", description)
    return Group(stored)


# ---- reading


def is_family(root: Group) -> bool:
    """Whether a file holds a family."""
    return isinstance(root.members.get(FAMILY), Group)


def axes_of(family: Group) -> tuple[Axis, ...]:
    """The axes in their order; every point counts as given."""
    groups = sorted(family["axes"].members.items(), key=lambda item: item[1].attributes["order"])
    axes = []
    for name, group in groups:
        keys = []
        for word, member in group.members.items():
            if word in _MEASURED:
                continue
            unit = member.units.removeprefix("1") if member.units.startswith("1/") else member.units
            values = tuple(member.data.tolist())
            texts = tuple(f"{value!r} {unit}".removesuffix(" 1") for value in values)
            key = member.description.removeprefix("recipe key ")
            keys.append(Swept(key, name if word == "value" else word, unit, texts, values))
        axes.append(Axis(tuple(keys)))
    return tuple(axes)


def error_of(axis: Group) -> np.ndarray | None:
    """The error between the points of an axis (N - 1,), not a number where it is not known; None where nothing was measured."""
    if "error" not in axis.members:
        return None
    error = axis["error"].data
    return np.where(axis["measured"].data, error, np.nan) if "measured" in axis.members else error


def members_of(family: Group) -> list[Member]:
    """The members of all points, the last axis fastest."""
    columns = [family[f"members/{name}"].data.reshape(-1).tolist() for name in Member._fields]
    return [Member(*(value.decode(errors="replace") if isinstance(value, bytes) else value for value in row))
            for row in zip(*columns, strict=True)]


def tables_of(family: Group) -> Tables:
    """What is interpolated."""
    scaled = tuple(np.array([axis.first.scaled(value) for value in axis.first.values]) for axis in axes_of(family))
    table = family["phase"].data
    ratios = family["ratios"].data if "ratios" in family.members else np.zeros((*table.shape[:-1], 0, table.shape[-1]))
    return Tables(scaled, family["theta"].data, family["sigma_s"].data, family["sigma_a"].data, table, ratios,
                  family["members/reason"].data != b"")


def optics_of(medium: Group) -> Optics:
    """The figures of a group `medium`; its others follow from them."""
    names = ["phase", *(name for name in ("s12", "s33", "s34") if name in medium.members)]
    bias = medium.members.get("phase_bias")
    # copies: arrays of a file that was read are views of all its bytes
    return Optics(*(np.array(medium[name].data, float) for name in ("theta", "sigma_s", "sigma_a")),
                  np.stack([np.asarray(medium[name].data, float) for name in names], axis=1),
                  None if bias is None else np.array(bias.data, float))


# ---- the contract


def departures(root: Group) -> list[str]:
    """Where a family departs from what its readers count on, in words."""
    family = root.members[FAMILY]
    try:
        return [f"{FAMILY}/{rule}" for rule in _departures(family, root["wavelength"].data.size)]
    except (KeyError, TypeError, AttributeError, ValueError, IndexError) as error:
        return [f"{FAMILY}: its structure is not that of a family ({type(error).__name__}: {error})"]


def _departures(family: Group, wavelengths: int) -> Iterable[str]:
    if family.attributes.get("stage_version") != VERSION or family.attributes.get("method") not in METHODS:
        yield "attributes: another version, or no method of interpolation"
        return
    reached = {"achieved_error": float} if "achieved_error" in family.attributes else {}
    for name, kind in {**_ATTRIBUTES, **reached}.items():
        if not isinstance(family.attributes.get(name), kind):
            yield f"attributes: {name} is missing or not {kind.__name__}"
            return
    axes = family["axes"].members
    if sorted(group.attributes["order"] for group in axes.values()) != list(range(len(axes))) or not axes:
        yield "axes: they have no order"
        return
    for name, group in axes.items():
        values = group["value"].data
        if any(member.units not in _UNITS for word, member in group.members.items() if word not in _MEASURED):
            yield f"axes/{name}: not in one of the units {', '.join(_UNITS)}"
            return
        if not all(_numbers(member.data, values.shape) for word, member in group.members.items() if word not in _MEASURED):
            yield f"axes/{name}: not numbers of one length"
        if any(group[word].data.shape != (len(values) - 1,) for word in _MEASURED if word in group.members):
            yield f"axes/{name}: not an error between each point and the next"
        if not len(values) or not (np.diff(values) > 0).all():
            yield f"axes/{name}/value: not ascending"
        if (group.attributes["scale"] == "log") != (values.min() > 0):
            yield f"axes/{name}: its scale is not that of its values"
    shape = tuple(len(axis.first.values) for axis in axes_of(family))
    theta = family["theta"].data
    yield from (f"theta: {rule}" for rule in angles(theta))
    wanted = {name: (*shape, wavelengths) for name in _PER_WAVELENGTH} | {"phase": (*shape, wavelengths, len(theta))}
    wanted |= {"ratios": (*shape, wavelengths, 3, len(theta))} if "ratios" in family.members else {}
    yield from (f"{name}: not numbers of the shape {expected}" for name, expected in wanted.items()
                if not _numbers(family[name].data, expected))
    for name in Member._fields:
        data = family[f"members/{name}"].data
        if data.shape != shape or data.dtype.kind != ("f" if name == "achieved" else "S"):
            yield f"members/{name}: not {'numbers' if name == 'achieved' else 'texts'} of the shape {shape}"


def _of_points(function, table: np.ndarray) -> np.ndarray:
    """A function of tables (..., L, A) along A, point by point: of them all it would take several times their memory."""
    return np.array([function(point) for point in table.reshape(-1, *table.shape[-2:])]).reshape(*table.shape[:-2], -1)


def _numbers(data: np.ndarray, shape: tuple[int, ...]) -> bool:
    return data.shape == shape and data.dtype.kind == "f" and all((np.abs(part) < LARGEST).all() for part in data)


def physics(root: Group) -> list[str]:
    """What is wrong with the values, in words."""
    family = root.members[FAMILY]
    tables = tables_of(family)
    present = ~tables.missing
    if not present.any():
        return [f"{FAMILY}: no point is there"]
    sigma_t = tables.sigma_s + tables.sigma_a
    integral, cosine = (_of_points(partial(function, tables.theta), tables.phase)[present]
                        for function in (phase.phase_integral, phase.mean_cosine))
    rules = {
        "a coefficient below 0": (tables.sigma_s >= 0).all() and (tables.sigma_a >= 0).all(),
        "sigma_t is not sigma_s + sigma_a": np.allclose(family["sigma_t"].data, sigma_t, rtol=1e-12, atol=0),
        "albedo is not sigma_s / sigma_t": np.allclose(family["albedo"].data * sigma_t, tables.sigma_s, rtol=1e-12, atol=0),
        "phase below 0": not tables.phase.size or tables.phase.min() >= 0,
        "phase does not integrate to 1": np.allclose(integral, 1, rtol=0, atol=1e-12),
        "g is not the mean cosine of phase": np.allclose(family["g"].data[present], cosine, rtol=0, atol=1e-12),
        "a ratio beyond 1": not tables.ratios.size or max(-tables.ratios.min(), tables.ratios.max()) <= 1 + 1e-9}
    return [f"{FAMILY}: {rule}" for rule, holds in rules.items() if not holds]
