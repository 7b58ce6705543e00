"""What a method of rendering declares: keys of scenes, `auto`, `bake compare`, `bake trade`, requirements, budget, docs and
messages read it.

Each renderer of materials has a class of its own with what its passes go by, `renderers/X/declaration.py`, and its methods in
`renderers/X/declared/`, a file and a line each.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any, NamedTuple

from bakery.errors import Problem
from bakery.grammar import fields
from bakery.grammar.text import Mapping as MappingNode
from bakery.grammar.text import Sequence as SequenceNode
from bakery.grammar.text import owner
from renderers.scene.common import node_at


@dataclass(frozen=True, kw_only=True)
class SceneMethod:
    """A value that the key `method` of a material may have.

    name : as scenes say it
    words : for people
    brings : which light, and how
    leaves_out : of light, or of what it is right; a sentence of each report. "" where it is nothing, or known only in a scene
    exact : without an error of its own, unless a report's `left_out` says what a picture lacks
    keeps : within a scene's tolerance by itself
    error : tolerance of a scene -> the error that it states before it is measured, relative to the picture's mean
    measured : what measures its error in a scene, a function of the renderer; None: nothing does
    keys : dotted keys of an entry that it takes, of those that not all methods take
    points : settings with which `bake trade` tries it, "" for those of the scene; () where it does not
    candidates : names of the methods that it chooses from (`renderers.choice`); the first one without pilots
    lacks : (assets, world) -> what of the light it cannot find there, so that it is no candidate; "" where it finds all
    slow : (scene, assets, world) -> why its passes take long there, so that a draft without pilots has another one; "" where they
        do not
    unfit : (scene, number, asset, world) -> why an entry, by its number, cannot be rendered so, or would be another material; ""
    pilot : seconds that a pilot of it takes at least, with what it loads
    ends_early : whether it ends long paths that others follow, so that its passes may take much less time than theirs
    continuous : whether a medium stands for the material, of which nothing is told apart
    deviation : (scene, number, asset, world) -> by how much pixels deviate from such a medium because of what could be told apart
        of an entry, by its number: root mean square over the picture's mean; of a surface, over the entry's light, because
        light spreads in the material
    beside : whether a material by it may stand beside materials of other kinds
    surface : whether the material is a surface of the Mitsuba scene by it, into which no path goes
    surface_far : whether it is one by it far from the camera, and paths go into it near
    far_share : (scene, number, asset, world) -> how much of what the camera sees of an entry, by its number, is that surface
    stages : of the asset that it reads; () those of its kind
    kind : of materials, as `renderers.scene.entries` names them
    """

    name: str
    kind: str
    words: str
    brings: str
    leaves_out: str = ""
    exact: bool = False
    keeps: bool = False
    error: Callable[[float], float] = lambda tolerance: 0.0
    measured: Callable[..., Any] | None = None
    keys: tuple[str, ...] = ()
    points: tuple[str, ...] = ("",)
    candidates: tuple[str, ...] = ()
    lacks: Callable[[Sequence[Any], Any], str] = lambda assets, world: ""
    slow: Callable[[Any, Sequence[Any], Any], str] = lambda scene, assets, world: ""
    unfit: Callable[..., str] = lambda scene, number, asset, world: ""
    pilot: float = 1.0
    ends_early: bool = False
    continuous: bool = False
    deviation: Callable[..., float] = lambda scene, number, asset, world: 0.0
    beside: bool = False
    surface: bool = False
    surface_far: bool = False
    far_share: Callable[..., float] = lambda scene, number, asset, world: 0.0
    stages: tuple[str, ...] = ()


class Points(NamedTuple):
    """Names of methods, as `bake compare` and `bake trade` take them: without an error, within a tolerance, all to be tried."""

    exact: tuple[str, ...]
    kept: tuple[str, ...]
    tried: tuple[str, ...]


def table(places: Iterable[str]) -> dict[str, Any]:
    """The declarations at `module:NAME`, by the name of their method."""
    parts = (target.partition(":") for target in places)
    methods = (getattr(import_module(module), name) for module, _, name in parts)
    return {method.name: method for method in methods}


def settled(methods: Mapping[str, Any], name: str) -> str:
    """The method of a name; of one that chooses from others the one that it is without pilots."""
    return next(iter(methods[name].candidates), name)


def points(methods: Mapping[str, SceneMethod]) -> Points:
    """What they declare; those without an error come first."""
    tried = [":".join(filter(None, (method.name, settings)))
             for method in sorted(methods.values(), key=lambda method: not method.exact) for settings in method.points]
    return Points(tuple(name for name, method in methods.items() if method.exact),
                  tuple(name for name, method in methods.items() if method.keeps), tuple(tried))


def unused(root: MappingNode, values: Mapping[str, Any], methods: Mapping[str, SceneMethod]) -> Iterator[Problem]:
    """Keys of entries that their method does not take; `values` as `problems` of a renderer has them."""
    entries = root.get("materials")
    for number in range(len(entries) if isinstance(entries, SequenceNode) else 0):
        method = methods.get(values.get(f"materials[{number}].method", ""))
        for key in dict.fromkeys(key for declared in methods.values() for key in declared.keys):
            node = node_at(root, f"materials[{number}].{key}")
            if method is not None and node is not None and key not in method.keys:
                takers = [name for name, declared in methods.items() if key in declared.keys]
                yield owner(node).problem(f"found {key}, which method {method.name} does not use",
                                          f"expected it with method: {fields.one_of(takers)}")
