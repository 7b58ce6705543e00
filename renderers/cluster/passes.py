"""Passes of one picture on the workers of a cluster.

A pass depends on its number alone, so workers render passes before it is their turn; here they are added up one after the other,
as on one machine.
"""

import math
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from bakery.errors import BakeryError
from renderers.cluster import files
from renderers.pictures.engine import rendered_here
from renderers.pictures.passes import Rendering
from renderers.pictures.progressive import fingerprint
from renderers.pictures.running import Render
from renderers.pictures.versions import versions

_AHEAD = 2  # passes a thread of the cluster that are asked for at once, at least: one that runs and the next one
_LAST: dict = {}  # in a worker: key of a picture -> its `renderers.pictures.passes.Rendering`; of the last one only


class Picture(NamedTuple):
    """What workers have to know of a picture, besides its files.

    key : of the picture among those of all scenes, seeds and sizes
    path, settings : of the scene where it was read, and what was set by hand
    handed : of `renderers.cluster.files.handed`
    quality, variant, seed : as `renderers.pictures.passes.render` takes them
    versions : of libraries that decide the bytes, where the passes are added up
    """

    key: str
    path: str
    settings: dict[str, str]
    handed: dict
    quality: str | None
    variant: str
    seed: int
    versions: dict[str, str]


class Pass(NamedTuple):
    """A pass that was rendered, or why it was not.

    layers : (H, W, 3) by name, as `renderers.pictures.engine.Part.render` gives them
    seconds : that it took
    fault, status : message and exit status where it could not be; "" and 0
    """

    layers: dict[str, np.ndarray]
    seconds: float
    fault: str = ""
    status: int = 0


def workers(cluster):
    """What `renderers.pictures.passes.render` takes for `elsewhere`: the workers of a `bakery.run.dask.Cluster`.

    Passes raise BakeryError where a worker cannot render them, or none is left.
    """
    return partial(_ahead, cluster)


@contextmanager
def _ahead(cluster, rendering):
    passes = _Ahead(cluster, rendering)
    try:
        yield passes.draw
    finally:
        passes.close()


class _Ahead:
    """Passes that are under way."""

    def __init__(self, cluster, rendering):
        scene = rendering.job.scene
        self._cluster, self._stop, self._means = cluster, rendering.stop, rendering.estimate.means
        self._picture = Picture(_key(rendering), str(scene.path), dict(scene.overrides), files.handed(scene),
                                rendering.job.quality, rendering.variant, rendering.seed, versions())
        self._content = files.content(files.needed(scene))
        self._arriving: dict[str, Iterator] = {}  # name of a part -> its batch of passes, as they come
        self._there: dict[tuple[str, int], Pass] = {}  # passes before their turn
        self._end: dict[str, int] = {}  # name of a part -> passes that were asked for

    def draw(self, part, number):
        """Layers of a pass of a part, and the seconds until another one is there."""
        if number >= self._end.get(part.name, 0):
            self._ask(part, number)
        while (part.name, number) not in self._there:
            position, arrived = next(self._arriving[part.name])
            if arrived.fault:
                fault = BakeryError(arrived.fault)
                fault.exit_status = arrived.status
                raise fault
            self._there[part.name, position] = arrived
        rendered = self._there.pop((part.name, number))
        return rendered.layers, rendered.seconds / self._threads

    @property
    def _threads(self):
        return max(1, sum(self._cluster.threads.values()))

    def _ask(self, part, number):
        """Asks for passes from this one on: all that samples leave, or as many as there were, since nobody knows the last one."""
        count = max(_AHEAD * self._threads, number)
        if self._stop.samples is not None:
            remaining = max(1, math.ceil((self._stop.samples - self._means[part.name].samples) / part.samples))
            open_ended = self._stop.noise is not None or self._stop.time is not None
            count = min(count, remaining) if open_ended else remaining
        numbers = range(number, number + count)
        alike = ([argument] * count for argument in (self._content, self._picture, part.name))
        arriving = self._cluster.arriving(rendered, *alike, numbers)
        self._arriving[part.name] = ((number + position, passed) for position, passed in arriving)
        self._end[part.name] = number + count

    def close(self):
        """Takes back what no longer needs to be rendered."""
        for arriving in self._arriving.values():
            arriving.close()


def _key(rendering) -> str:
    samples = [part.samples for part in rendering.estimate.parts]
    return fingerprint(rendering.estimate.identity, samples, rendering.method.name, rendering.job.quality, rendering.variant)


def rendered(content: Mapping[str, bytes], picture: Picture, part: str, number: int) -> Pass:
    """Renders a pass in a worker."""
    if unlike := files.unlike(picture.versions):
        return Pass({}, 0.0, unlike, 2)
    with files.ONE_AT_A_TIME:
        try:
            parts = {candidate.name: candidate for candidate in _rendering(content, picture).estimate.parts}
            return Pass(*rendered_here(parts[part], number))
        except BakeryError as error:
            return Pass({}, 0.0, str(error).replace(files.unpacked(content), ""), error.exit_status)


def _rendering(content, picture):
    """The scene of a picture with its method, prepared once for all passes that follow each other."""
    if picture.key not in _LAST:
        _LAST.clear()
        scene = files.scene_below(files.unpacked(content), picture.path, picture.settings, picture.handed)
        # nothing is written there, but pictures have a place that can be written
        target = Path(tempfile.gettempdir(), "bakery-passes.png")
        _LAST[picture.key] = Rendering(Render(scene, target, quality=picture.quality, overwrite=True), picture.variant,
                                       picture.seed)
    return _LAST[picture.key]
