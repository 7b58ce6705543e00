"""Bodies that may be rendered as surfaces: what is offered of them beside what fills them.

A body whose asset holds a surface is offered as one where the error that is expected of that (`SceneMethod.deviation`: how far
light spreads, over pixels and over the body's radius) is no more than a method which `auto` takes may have.  One that nothing can
fill, such as an open sheet, is a surface in any case.
"""

from __future__ import annotations

from renderers.scene import budget, candidates, entries
from renderers.scene.budget import percent
from renderers.scene.candidates import Candidate


def beside(opened, world, listed: tuple[Candidate, ...]) -> tuple[tuple[Candidate, ...], dict[str, str]]:
    """The candidates of a scene and those by which bodies are surfaces, and of others by name why they are none.

    opened : `renderers.choice.Opened`;  listed : the candidates without surfaces, () where there is nothing to choose
    """
    scene = opened.scene
    able = [number for number in candidates.surfaces(scene) if not _of(scene, number, "surface").unfit(
        scene, number, opened.assets[number], world)]
    if not able:
        return listed, {}
    listed = listed or (candidates.with_surfaces(scene, (), 0.0),)
    expected = {number: _of(scene, number, "surface").deviation(scene, number, opened.assets[number], world) for number in able}
    empty = {number: reason for number in able if (reason := _of(scene, number, "first").unfit(
        scene, number, opened.assets[number], world))}
    allowed = budget.ROOM * (scene.values.tolerance or budget.DEFAULT)
    fitting = {number for number in able if expected[number] <= allowed}
    chosen = dict.fromkeys(tuple(sorted(numbers)) for numbers in (set(empty), fitting | set(empty)) if numbers)
    offered = tuple(candidates.with_surfaces(scene, numbers, max(expected[number] for number in numbers)) for numbers in chosen)
    refused = {f"materials[{number}] by surface": "as far as light spreads in it, over pixels and the body's radius, an error "
               f"of {percent(expected[number])} is expected, and {percent(allowed)} allowed"
               for number in able if number not in fitting and number not in empty}
    if not empty:
        return (listed[0], *offered, *listed[1:]), refused
    why = "; ".join(f"materials[{number}]: {reason}" for number, reason in empty.items())
    return offered, {candidate.name: why for candidate in listed} | refused


def _of(scene, number, method):
    """What an entry declares of its method as a surface, or of the first that stands beside others."""
    kind = scene.values.materials[number].kind
    return entries.declared(kind)[candidates.surface_of(kind) if method == "surface" else candidates.beside(kind)[0]]
