"""Bodies that may be rendered as surfaces: what is offered of them beside what fills them.

A body whose asset holds a surface is offered as one where the error that is expected of that (`SceneMethod.deviation`: how far
light spreads, over pixels and over the body's radius) is no more than a method which `auto` takes may have.  One that nothing can
fill, such as an open sheet, is a surface in any case.  One that is near in parts is offered as a surface from some distance to
the camera on (`SceneMethod.far_share`), where that is much of what the camera sees of it.
"""

from __future__ import annotations

from renderers.scene import budget, candidates, entries
from renderers.scene.budget import percent
from renderers.scene.candidates import Candidate

_WORTH = 0.1  # share of a body that is its surface, below which paths cost as much


def beside(opened, world, listed: tuple[Candidate, ...]) -> tuple[tuple[Candidate, ...], dict[str, str]]:
    """The candidates of a scene and those by which bodies are surfaces, and of others by name why they are none.

    opened : `renderers.choice.Opened`;  listed : the candidates without surfaces, () where there is nothing to choose
    """
    scene, (listed, unlike) = opened.scene, _of_grains(opened, world, listed)
    able = [number for number in candidates.surfaces(scene) if not _of(scene, number, "surface").unfit(
        scene, number, opened.assets[number], world)]
    if not able:
        return listed, unlike
    listed = listed or (candidates.with_surfaces(scene, (), 0.0),)
    expected = {number: _of(scene, number, "surface").deviation(scene, number, opened.assets[number], world) for number in able}
    empty = {number: reason for number in able if (reason := _of(scene, number, "first").unfit(
        scene, number, opened.assets[number], world))}
    allowed = budget.ROOM * (scene.values.tolerance or budget.DEFAULT)
    fitting = {number for number in able if expected[number] <= allowed}
    chosen = dict.fromkeys(tuple(sorted(numbers)) for numbers in (set(empty), fitting | set(empty)) if numbers)
    offered = tuple(candidates.with_surfaces(scene, numbers, max(expected[number] for number in numbers)) for numbers in chosen)
    changing = _changing(opened, world, [number for number in able if number not in fitting and number not in empty])
    if changing:
        beside_them = tuple(sorted(fitting | set(empty)))
        error = max((*changing.values(), *(expected[number] for number in beside_them)))
        offered = (*offered, candidates.with_surfaces(scene, beside_them, error, tuple(changing)))
    refused = {f"materials[{number}] by surface": "as far as light spreads in it, over pixels and the body's radius, an error "
               f"of {percent(expected[number])} is expected, and {percent(allowed)} allowed"
               for number in able if number not in fitting and number not in empty} | unlike
    if not empty:
        return (listed[0], *offered, *listed[1:]), refused
    why = "; ".join(f"materials[{number}]: {reason}" for number, reason in empty.items())
    return offered, {candidate.name: why for candidate in listed} | refused


def _of_grains(opened, world, listed):
    """Candidates, without those by which entries are surfaces from some distance on where that cannot be or is not worth while;
    and those that are too far off, by name with the reason.  Grains have such ones among their methods."""
    scene, kept, refused = opened.scene, [], {}
    allowed = budget.ROOM * (scene.values.tolerance or budget.DEFAULT)
    for candidate in listed:
        stated = [(entries.declared(scene.values.materials[number].kind)[candidate.methods[number]],
                   (scene, number, opened.assets[number], world)) for number in candidate.surfaces]
        if stated and (any(method.unfit(*about) for method, about in stated)
                       or max(method.far_share(*about) for method, about in stated) < _WORTH):
            continue
        if (error := max((method.deviation(*about) for method, about in stated), default=0.0)) > allowed:
            refused[candidate.name] = f"an error of {percent(error)} is expected of the surface, and {percent(allowed)} allowed"
        else:
            kept.append(candidate.off_by(error)._replace(expected=error) if stated else candidate)
    return tuple(kept), refused


def _changing(opened, world, able) -> dict[int, float]:
    """Of bodies those that are offered as surfaces from some distance on, with the error that is expected of that."""
    scene = opened.scene
    if any(entries.PACKAGES.get(entry.kind) and not candidates.surface_of(entry.kind) for entry in scene.values.materials):
        return {}  # where particles or grains are told apart nothing renders them so
    allowed, expected = budget.ROOM * (scene.values.tolerance or budget.DEFAULT), {}
    for number in able:
        kind, about = scene.values.materials[number].kind, (scene, number, opened.assets[number], world)
        method = entries.declared(kind)[candidates.far_surface_of(kind)]
        if not method.unfit(*about) and method.far_share(*about) >= _WORTH and (error := method.deviation(*about)) <= allowed:
            expected[number] = error
    return expected


def _of(scene, number, method):
    """What an entry declares of its method as a surface, or of the first that stands beside others."""
    kind = scene.values.materials[number].kind
    return entries.declared(kind)[candidates.surface_of(kind) if method == "surface" else candidates.beside(kind)[0]]
