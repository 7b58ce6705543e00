"""What a scene of several materials may say: the methods of each kind, and what they take."""

from collections.abc import Iterator

from bakery.errors import Problem
from bakery.grammar import fields
from bakery.grammar.text import Mapping, Scalar, Sequence, owner
from renderers.scene.candidates import UNKNOWN_TO_MEDIA, beside
from renderers.scene.common import node_at
from renderers.scene.entries import KEYS, KINDS, declared, is_surface, methods

# kind -> methods that may stand beside other materials; the first one is what `auto` is
METHODS = {kind: beside(kind) for kind in KINDS}
NEEDS: tuple[str, ...] = ()  # stages of the asset: those of the entries
UNUSED = {"film.wavelengths": "none: materials are rendered at the wavelengths of their assets"}  # common keys
RESUMES = True
CHOICE = "method", ("auto",)  # the key of the method of all entries, and what it may be
EXACT, KEPT = ("auto",), ("auto",)  # of `bake trade`: without an error of their own; within a scene's tolerance
PACE = 5e-4  # s of a core that a pixel takes to a relative variance of 1
POINTS = ("auto",)
_OF_GRAINS = {"surface_from": "grains beside other materials are no surfaces"}
_UNUSED = {"spread": "no method here switches from grains to their medium", "footprint": "method query is not there",
           "boundary.tables": "method paths reads no tables"}  # keys of entries that other renderers use

_OF_METHODS = {"body": ("layer", "surface_from"), "grains": ("widen",)}  # kind -> keys that some of its methods take
_NOT_OF_SURFACES = {"boundary": "that of a surface is baked, as surface.boundary of the recipe says"}


def chosen(kind: str, method: str) -> str:
    """The method that renders an entry."""
    return METHODS[kind][0] if method == "auto" else method


def problems(root: Mapping, values: dict) -> Iterator[Problem]:
    """What has to hold between keys of the entries."""
    listed = root.get("materials")
    for number, entry in enumerate(listed if isinstance(listed, Sequence) else ()):
        if not isinstance(entry, Mapping):
            continue
        key = f"materials[{number}]"
        kind, method = values[f"{key}.as"], values[f"{key}.method"]
        if method in methods(kind) and method not in ("auto", *METHODS[kind]):  # of others all renderers say it
            stated = next((at["method"] for at in (entry, root) if isinstance(at.get("method"), Scalar)), None)
            message, expected = f"found {method} beside other materials", f"expected {fields.one_of(['auto', *METHODS[kind]])}"
            yield owner(stated or entry).problem(message, expected, key=f"{key}.method")
        surface = is_surface(kind, method)
        for name, reason in ((_NOT_OF_SURFACES if surface else {}) | (_OF_GRAINS if kind == "grains" else {})).items():
            if name in entry:
                yield entry.names[name].problem(f"found {name}, and {reason}", "leave it out")
        for name in _OF_METHODS.get(kind, ()) if method in (*METHODS[kind], "auto") else ():
            takers = [taker for taker in ("auto", *METHODS[kind]) if name in declared(kind)[taker].keys]
            if name in entry and method not in takers:
                yield entry.names[name].problem(f"found {name}, which method {method} does not use",
                                                f"expected it with method: {fields.one_of(takers)}")
        for name, reason in _UNUSED.items():
            if (node := node_at(root, f"{key}.{name}")) is not None:
                yield owner(node).problem(f"found {name.rpartition('.')[2]}, and {reason} beside other materials",
                                          "leave it out")
        if method in METHODS[kind] and declared(kind)[method].continuous:
            for name in UNKNOWN_TO_MEDIA:
                if name in entry and name in KEYS[kind]:
                    message = f"found {name}, which method {method} does not know beside other materials"
                    yield entry.names[name].problem(message, f"expected it with method: {chosen(kind, 'auto')}")
