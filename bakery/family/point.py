"""The asset of any place between the points of a family."""

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

import bakery
from bakery.errors import AssetError, UsageError
from bakery.family.axes import Axis, file_name, in_words, points, settings, shown
from bakery.family.refine import ROOM
from bakery.family.tree import axes_of, error_of, members_of, tables_of
from bakery.grammar.overrides import apply
from bakery.grammar.text import Source, parse
from bakery.physics.medium.between import cell, hole, interpolated
from bakery.stages.conform import FAMILY
from bakery.stages.medium.stage import members_of as medium_of
from bakery.store.hashes import HASH, seal
from bakery.store.tree import Group, read_text, text


class Place(NamedTuple):
    """Values on the axes in SI units, and where they stand in words."""

    values: tuple[float, ...]
    words: str


def place_of(root: Group, values: Sequence[float]) -> Place:
    """A place within the axes; UsageError outside of them."""
    axes = axes_of(root.members[FAMILY])
    for axis, value in zip(axes, values, strict=True):
        nodes = axis.first.values
        margin = 1e-9 * max(abs(nodes[0]), abs(nodes[-1]))
        if not nodes[0] - margin <= value <= nodes[-1] + margin:
            low, high = (shown(node, axis.first.units) for node in (nodes[0], nodes[-1]))
            micro = f' ("{value:g} um"?)' if axis.first.units == "m" and nodes[0] <= 1e-6 * value <= nodes[-1] else ""
            raise UsageError(f"{axis.first.name}: found {shown(value, axis.first.units)}; the family covers "
                             + (f"{low} to {high}" if len(nodes) > 1 else f"{low} alone") + micro)
    values = tuple(_at_point(axis.first.values, value) for axis, value in zip(axes, values, strict=True))
    return Place(values, in_words(axes, values))


def _at_point(nodes: Sequence[float], value: float) -> float:
    """The value, or the point that it means but for rounding."""
    node = min(nodes, key=lambda node: abs(node - value))
    return node if abs(node - value) <= 1e-9 * max(abs(node), abs(value)) else float(value)


def place_path(path: str, root: Group, index: Place) -> str:
    """A path for the asset of a place, beside the family's: `clouds_radius_5e-06.h5`."""
    family = Path(path)
    return str(family.with_name(f"{family.stem}_{file_name(axes_of(root.members[FAMILY]), index.values)}"))


def asset_at(root: Group, path: str, index: Place) -> Group:
    """The tree of an asset with the interpolated group `medium`, as `bakery.store.read.read` would give it.

    Raises AssetError where a point that the place needs has failed.
    """
    family = root.members[FAMILY]
    axes, tables = axes_of(family), tables_of(family)
    scaled = [axis.first.scaled(value) for axis, value in zip(axes, index.values, strict=True)]
    gap = hole(tables, scaled)
    if gap is not None:
        number = int(np.ravel_multi_index(gap, tables.missing.shape))
        at = list(points([axis.first.values for axis in axes]))[number]
        raise AssetError(f"{path}: {index.words} needs the point {in_words(axes, at)}, which failed: "
                         f"{members_of(family)[number].reason}")
    optics = interpolated(tables, scaled, str(family.attributes["method"]))
    content = str(root.attributes[HASH])
    key = json.dumps([content, index.values])
    attributes = family.attributes
    medium = Group(medium_of(optics.sigma_s, optics.sigma_a, optics.theta, optics.elements), {
        "stage": "medium", "stage_version": attributes["medium_version"], "input_hash": hashlib.sha256(key.encode()).hexdigest(),
        **_errors(family, axes, cell(tables, scaled))})
    note = f"interpolated at {index.words} from the family {root.attributes['name']}, {attributes['method']}"
    told = {"notes": text(note, "remarks of the stage")}
    unknown = _unknown(family, axes, cell(tables, scaled))
    told |= {"missed": text("\n".join(unknown), "targets that were missed")} if unknown else {}
    provenance = Group({"medium": Group(told)},
                       {"interpolated_at": index.words, "family": path, "family_content_hash": content})
    source = Source("recipe", read_text(root["recipe"]))
    recipe = apply(source, parse(source), settings(axes, index.values))[0]
    members = {"recipe": text(recipe, "the recipe that would bake this"),
               "wavelength": root["wavelength"], "medium": medium, "provenance": provenance}
    return seal(Group(members, {"name": root.attributes["name"], "bakery_version": bakery.__version__}))


def _errors(family: Group, axes: Sequence[Axis], cells: Sequence[slice]) -> dict:
    """Tolerance, error and what it is of: at a point of all axes the member's, else of the interpolation as well."""
    allowed, achieved = family.attributes, family["members/achieved"].data
    between = [axis for axis, nodes in zip(axes, cells, strict=True) if nodes.stop - nodes.start > 1]
    if not between:
        member = np.reshape(achieved, [len(axis.first.values) for axis in axes])[tuple(nodes.start for nodes in cells)]
        return {"tolerance": allowed["member_tolerance"], "achieved_error": float(member),
                "error_measure": "error of the member at this point; at angles that all members share"}
    measured = [error_of(family[f"axes/{axis.first.name}"]) for axis in between]
    interpolation = sum(float(np.nanmax(error)) for error in measured if error is not None and not np.isnan(error).all()) / ROOM
    return {"tolerance": allowed["tolerance"] + allowed["member_tolerance"],
            "achieved_error": interpolation + float(achieved.max()),
            "error_measure": "largest error of the members, and of the interpolation between them where that was measured"}


def _unknown(family: Group, axes: Sequence[Axis], index: Sequence[slice]) -> list[str]:
    """The intervals that a place lies in whose error is not known, in words."""
    unknown = []
    for axis, nodes in zip(axes, index, strict=True):
        ends, error = axis.first.values[nodes], error_of(family[f"axes/{axis.first.name}"])
        if len(ends) > 1 and error is not None and np.isnan(error[nodes.start]):
            low, high = (in_words([axis], [end]) for end in ends)
            unknown.append(f"the error of the interpolation between {low} and {high} is not known: a point there failed")
    return unknown
