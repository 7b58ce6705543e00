"""Passes of one picture on the workers of a cluster.

A pass depends on its number alone, so workers render passes before it is their turn; here they are added up one after the other,
as on one machine.
"""

import math
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import numpy as np

from renderers.cluster import files
from renderers.pictures.engine import rendered_here
from renderers.pictures.passes import Rendering
from renderers.pictures.progressive import fingerprint
from renderers.pictures.running import Render

_AHEAD = 2  # passes a thread of the cluster that are asked for at once, at least: one that runs and the next one
_LAST: dict = {}  # in a worker: key of a picture -> its `renderers.pictures.passes.Rendering`; of the last one only


class Picture(NamedTuple):
    """What workers have to know of a picture, besides its files.

    key : of the picture among those of all scenes, seeds and sizes
    scene : `renderers.cluster.files.Sent`
    quality, variant, seed : as `renderers.pictures.passes.render` takes them
    """

    key: str
    scene: files.Sent
    quality: str | None
    variant: str
    seed: int


def workers(cluster):
    """What `renderers.pictures.passes.render` takes for `elsewhere`: the workers of a `bakery.run.dask.Cluster`.

    Passes raise BakeryError where a worker cannot render them, or none is left.
    """
    @contextmanager
    def ahead(rendering):
        passes = _Ahead(cluster, rendering)
        try:
            yield passes.draw
        finally:
            for arriving in passes.arriving.values():  # what no longer needs to be rendered is taken back
                arriving.close()

    return ahead


class _Ahead:
    """Passes that are under way."""

    def __init__(self, cluster, rendering):
        scene, estimate = rendering.job.scene, rendering.estimate
        self._cluster, self._stop, self._means = cluster, rendering.stop, estimate.means
        key = fingerprint(estimate.identity, [part.samples for part in estimate.parts], rendering.method.name,
                          rendering.job.quality, rendering.variant)
        self._picture = Picture(key, files.Sent.of(scene, scene.overrides), rendering.job.quality, rendering.variant,
                                rendering.seed)
        self._content = files.content(files.needed(scene))
        self.arriving: dict[str, Iterator] = {}  # name of a part -> its batch of passes, as they come
        self._there: dict[tuple[str, int], tuple] = {}  # passes before their turn
        self._end: dict[str, int] = {}  # name of a part -> passes that were asked for

    def draw(self, part, number):
        """Layers of a pass of a part, and the seconds until another one is there."""
        if number >= self._end.get(part.name, 0):
            self._ask(part, number)
        while (part.name, number) not in self._there:
            position, arrived = next(self.arriving[part.name])
            self._there[part.name, position] = arrived
        layers, seconds = self._there.pop((part.name, number))
        return layers, seconds / self._threads

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
        self.arriving[part.name] = ((number + position, passed) for position, passed in arriving)
        self._end[part.name] = number + count


def rendered(content: Mapping[str, bytes], picture: Picture, part: str, number: int) -> tuple[dict[str, np.ndarray], float]:
    """Renders a pass in a worker: its layers and the seconds that it took, as `renderers.pictures.engine.rendered_here`.

    Raises BakeryError as `renderers.cluster.files.on_worker`.
    """
    with files.on_worker(content, picture.scene.versions) as folder:
        if picture.key not in _LAST:  # prepared once for all passes that follow each other
            _LAST.clear()
            scene = picture.scene.below(folder)
            # nothing is written there, but pictures have a place that can be written
            target = Path(tempfile.gettempdir(), "bakery-passes.png")
            _LAST[picture.key] = Rendering(Render(scene, target, quality=picture.quality, overwrite=True), picture.variant,
                                           picture.seed)
        parts = {candidate.name: candidate for candidate in _LAST[picture.key].estimate.parts}
        return rendered_here(parts[part], number)
