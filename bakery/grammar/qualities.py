"""Qualities: what `draft`, `preview` and `final` mean to a bake, a render and a preview."""

from collections.abc import Mapping
from typing import NamedTuple

from bakery.errors import UsageError


class Panel(NamedTuple):
    """The preview of an asset."""

    width: int  # pixels of a panel
    samples: int  # a pixel and wavelength, at most
    noise: float  # at which it stops, of what the PNG shows
    time: float  # s, after which no pass is begun


class Quality(NamedTuple):
    """One quality."""

    words: str  # for people
    recipe: Mapping[str, str]  # settings of a bake, measured by `bake trade` (docs/trade.md)
    coarser: float  # times the noise of a scene; its samples and time over the square of that
    time: float | None  # s, after which a render ends whose scene sets no time; None: never
    panel: Panel  # of the preview of an asset
    marker: str  # in pictures of error against time


QUALITIES = {
    "draft": Quality("10 % of all light", {"tolerance": "10%", "measure": "integrated"}, 4.0, 60.0,
                     Panel(320, 8, 0.10, 30.0), "v"),
    "preview": Quality("3 % of all light", {"tolerance": "3%", "measure": "integrated"}, 2.0, None,
                       Panel(576, 32, 0.05, 120.0), "D"),
    "final": Quality("the recipe or scene as it stands", {}, 1.0, None, Panel(1280, 96, 0.01, 900.0), "s"),
}


def quality(name: str | None) -> Quality:
    """The quality of that name, `final` if None; UsageError where there is none."""
    name = "final" if name is None else name
    if name not in QUALITIES:
        raise UsageError(f'--quality: found "{name}"; expected {", ".join(QUALITIES)}')
    return QUALITIES[name]
