"""What was asked of a picture, and whether it got there: the one rule behind the exit status of renders.

A scene asks for a noise by `stop.noise`, or by its `tolerance`, of which noise has a share; quality `preview` asks for twice and
`draft` for four times as much.  A picture whose passes ended before is written, and has missed what was asked for.  So has one
whose method states an error of its own above the tolerance.  Two cases are told and are no misses: a scene that says neither,
whose 5 % nobody asked for, and a draft, which is a look within a time.
"""

from collections.abc import Sequence

from bakery.grammar.qualities import quality
from renderers.scene.budget import percent

_EARLY = {"time": "time", "samples": "samples", "request": "a request"}  # what may end passes before a noise, in words
SHARED = 0.5  # of the noise of pixels: where the means of regions have more than that, pixels share most of it


def coarser(name: str | None) -> float:
    """Times the noise that a quality asks for; UsageError where there is no such quality."""
    return quality(name).coarser


def limit(seconds: float | None, name: str | None) -> float | None:
    """Seconds of passes at a quality, of a scene whose `stop.time` is so long; None: no limit."""
    return quality(name).time if seconds is None else seconds / coarser(name) ** 2


def asked(values) -> bool:
    """Whether a scene asks for a noise, itself or by a tolerance.

    values : `renderers.scene.common.Common`
    """
    return values.stop.noise is not None or values.tolerance is not None


def unreached(stopped_by: str, wanted: float | None, noise: float | None, pixels: bool = False,
              regions: float = 0.0) -> tuple[str, ...]:
    """A sentence where `time`, `samples` or a `request` ended the passes before a noise was reached.

    stopped_by, wanted : of `renderers.pictures.progressive`: what ended the passes, and the noise that should have
    noise : that of the picture, or with `pixels` of 99 of 100 pixels; None where it is not known
    regions : noise of the means of regions, which has to be as low
    """
    if stopped_by not in _EARLY or wanted is None or noise is not None and max(noise, regions) <= wanted:
        return ()
    of = "of 99 of 100 pixels " if pixels else ""
    became = "after so few it is not known" if noise is None else f"it is {percent(noise)}"
    shared = "" if noise is None or regions <= noise else f", {percent(regions)} of the means of regions"
    return f"{_EARLY[stopped_by]} ended the passes: a noise {of}of {percent(wanted)} was wanted, {became}{shared}",


def verdict(values, name: str | None, sentences: Sequence[str], bias: float | None) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Sentences of `unreached`, and of a method's own error: those that tell of a miss of what was asked for, and the others.

    values : of the scene, `renderers.scene.common.Common`
    name : of the quality; final if None
    sentences : of `unreached`
    bias : error that the method states of itself, relative to the picture's mean; None where it states none
    """
    sentences = tuple(sentences)
    if values.tolerance is not None and bias is not None and bias > values.tolerance:
        sentences += f"the method's own error, {percent(bias)}, is above the tolerance of {percent(values.tolerance)}",
    return ((), sentences) if name == "draft" or not asked(values) else (sentences, ())
