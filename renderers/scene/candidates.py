"""Candidates: the ways in which a scene may be rendered, of which `auto` takes one, by what the methods of its entries declare.

Of one kind of material a candidate is a method, of all entries.  Of several kinds it is a method for each entry: those that are
`auto` have the first one of their kind that stands beside others, or another one that does.
"""

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from renderers import scene as scenes
from renderers.scene import entries

MOST = 6  # of several kinds
UNKNOWN_TO_MEDIA = ("fraction", "mixture")  # keys of entries that no medium that stands for them knows


class Candidate(NamedTuple):
    """A way to render a scene.

    name : for people and reports
    methods : of each entry, what it changes in the scene
    exact : without an error of its own
    stated : tolerance -> the error that its methods state, relative to the picture's mean
    pilot : seconds that a pilot of it takes at least
    lacks : (assets, world) -> what of the light it cannot find there
    slow : (scene, assets, world) -> why its passes take long there
    media : numbers of the entries for which media stand
    replaced : of these, those that nobody asked for: `auto` does not take them where the materials themselves are seen
    surfaces : numbers of the bodies that are surfaces, or are far from the camera, because `auto` may have them so
    expected : the error that is expected of those; None: what is stated
    eligible : whether it may be taken; another one only measures how far those are off
    ends_early : whether it ends long paths that the first one follows, so that its pilot may take much less time
    """

    name: str
    methods: tuple[str, ...]
    exact: bool = False
    stated: Callable[[float], float] = lambda tolerance: 0.0
    pilot: float = 1.0
    lacks: Callable[[Sequence[Any], Any], str] = lambda assets, world: ""
    slow: Callable[[Any, Sequence[Any], Any], str] = lambda scene, assets, world: ""
    media: tuple[int, ...] = ()
    replaced: tuple[int, ...] = ()
    surfaces: tuple[int, ...] = ()
    expected: float | None = None
    eligible: bool = True
    ends_early: bool = False

    def off_by(self, *errors: float) -> "Candidate":
        """The same, with further errors in what is stated."""
        return self._replace(stated=lambda tolerance: math.hypot(self.stated(tolerance), *errors))


def of(scene) -> tuple[Candidate, ...]:
    """The candidates for a scene, in the order in which they are tried; () where there is nothing to choose or to measure.

    The first one is that which is taken where no pilots are worth their time.
    """
    if scene.renderer in entries.PACKAGES.values():
        count, declared = len(scene.values.materials), entries.declared(scene.values.materials[0].kind)
        return tuple(Candidate(name, (name,) * count, method.exact, method.error, method.pilot, method.lacks, method.slow,
                               ends_early=method.ends_early, surfaces=tuple(range(count)) if method.surface_far else ())
                     for name in declared[scene.values.method].candidates for method in (declared[name],))
    return _of_several(scene.values.materials) if scene.renderer == "renderers.mixed" else ()


def by_methods(scene, methods: Sequence[str]):
    """A scene whose entries have these methods; with surfaces it is rendered as those of several kinds are."""
    listed = [entry.model_copy(update={"method": method})
              for entry, method in zip(scene.values.materials, methods, strict=True)]
    of_all = methods[0] if len(set(methods)) == 1 else None
    several = scene.section == "mixed" or any(entries.has_surface(entry.kind, entry.method) for entry in listed)
    section = "mixed" if several else scene.section
    return dataclasses.replace(scene, section=section, renderer=scenes.OF_MATERIALS[section],
                               values=scene.values.model_copy(update={"materials": listed, "method": of_all}))


# ---- bodies as surfaces


def surface_of(kind: str) -> str | None:
    """The method by which a material of a kind is a surface; None: there is none."""
    return next((name for name, method in entries.declared(kind).items() if method.surface), None)


def far_surface_of(kind: str) -> str | None:
    """The same, of a surface far from the camera."""
    return next((name for name, method in entries.declared(kind).items() if method.surface_far), None)


def surfaces(scene) -> list[int]:
    """Numbers of the entries of a scene that may be surfaces, as nobody asks for another method."""
    materials = scene.values.materials if scene.section in scenes.OF_MATERIALS else ()
    return [number for number, entry in enumerate(materials) if entry.method == "auto" and surface_of(entry.kind)]


def with_surfaces(scene, numbers: Sequence[int], deviation: float, changing: Sequence[int] = ()) -> Candidate:
    """The candidate by which these entries are surfaces, and the others what they are without pilots.

    changing : numbers of entries that are surfaces far from the camera
    deviation : the error that is expected of that, relative to the picture's mean
    """
    materials = scene.values.materials
    methods = [surface_of(entry.kind) if number in numbers else far_surface_of(entry.kind) if number in changing
               else beside(entry.kind)[0] if entry.method == "auto" else entry.method for number, entry in enumerate(materials)]
    name = methods[0] if len(set(methods)) == 1 else _named(methods, range(len(methods)))
    return _combined(materials, methods, ()).off_by(deviation)._replace(name=name, surfaces=(*numbers, *changing))


# ---- of several kinds


def beside(kind: str) -> tuple[str, ...]:
    """Methods of a kind that stand beside other materials; the first one is what `auto` is without pilots."""
    return tuple(name for name, method in entries.declared(kind).items() if method.beside)


def medium_for(kind: str) -> str | None:
    """The method of a medium that may stand for materials of a kind; None: there is none."""
    return next((name for name in beside(kind) if entries.declared(kind)[name].continuous), None)


def approximate(kind: str) -> str | None:
    """The method beside others by which materials of a kind are told apart with an error of its own; None: there is none."""
    told_apart = (name for name, method in entries.declared(kind).items() if method.beside and not method.exact
                  and not (method.continuous or method.surface or method.surface_far))
    return next(told_apart, None)


def _of_several(materials):
    first = [beside(entry.kind)[0] for entry in materials]
    asked = [method if entry.method == "auto" else entry.method for method, entry in zip(first, materials, strict=True)]
    groups, inexact = _groups(materials), [
        entries.declared(entry.kind)[method].continuous for entry, method in zip(materials, asked, strict=True)]
    combinations = [_combined(materials, asked, numbers) for numbers in _chosen(groups)]
    combinations[1:1] = _approximated(materials, asked)
    if any(inexact):  # by hand: what they are not tells how far they are off
        explicit = [exact if stands else method for exact, method, stands in zip(first, asked, inexact, strict=True)]
        combinations.insert(1, _combined(materials, explicit, (), eligible=False))
    return tuple(combinations) if len(combinations) > 1 else ()


def _approximated(materials, asked):
    """The candidate by which all entries whose method is open have what `approximate` gives, unless none has; it lacks what each
    of these does."""
    able = [number for number, entry in enumerate(materials) if entry.method == "auto" and approximate(entry.kind)]
    if not able:
        return []
    methods = [approximate(entry.kind) if number in able else method
               for number, (entry, method) in enumerate(zip(materials, asked, strict=True))]

    def lacks(assets, world):
        every = [entries.declared(materials[number].kind)[methods[number]].lacks([assets[number]], world) for number in able]
        return "; ".join(dict.fromkeys(every)) if all(every) else ""

    return [_combined(materials, methods, ())._replace(lacks=lacks)]


def _groups(materials):
    """Numbers of entries of the same material whose method is open, and a medium that may stand for each."""
    groups: dict[tuple, list[int]] = {}
    for number, entry in enumerate(materials):
        if entry.method == "auto" and medium_for(entry.kind) and not any(getattr(entry, key) for key in UNKNOWN_TO_MEDIA):
            groups.setdefault((entry.kind, entry.asset, entry.recipe), []).append(number)
    return list(groups.values())


def _chosen(groups):
    """Numbers of entries that are replaced: none, all, which alone may go through the quickest loop, one group, all but one."""
    numbers = range(len(groups))
    all_but = [tuple(group for group in numbers if group != kept) for kept in numbers]
    replaced = list(dict.fromkeys([(), tuple(numbers), *((group,) for group in numbers), *all_but]))
    return [sorted(number for group in chosen for number in groups[group]) for chosen in replaced[:MOST]]


def _combined(materials, methods, replaced, eligible=True):
    methods = [medium_for(entry.kind) if number in replaced else method
               for number, (entry, method) in enumerate(zip(materials, methods, strict=True))]
    declared = [entries.declared(entry.kind)[method] for entry, method in zip(materials, methods, strict=True)]
    media = tuple(number for number, method in enumerate(declared) if method.continuous)
    open_to_choice = [number for number, entry in enumerate(materials) if entry.method == "auto"]

    def lacks(assets, world):
        every = [declared[number].lacks([assets[number]], world) for number in open_to_choice if declared[number].exact]
        return "; ".join(dict.fromkeys(filter(None, every)))

    # of entries for which a medium may stand
    name = _named(methods, [number for number, entry in enumerate(materials) if medium_for(entry.kind)])
    return Candidate(name, tuple(methods), all(method.exact for method in declared),
                     lambda tolerance: math.hypot(*(method.error(tolerance) for method in declared)),
                     max(method.pilot for method in declared), lacks, media=media, replaced=tuple(replaced), eligible=eligible)


def _named(methods, numbers):
    """What entries of these numbers are rendered by."""
    by_method: dict[str, list[str]] = {}
    for number in numbers:
        by_method.setdefault(methods[number], []).append(f"materials[{number}]")
    return "; ".join(f"{', '.join(rows)} by {method}" for method, rows in by_method.items())
