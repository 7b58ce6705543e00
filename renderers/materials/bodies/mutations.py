"""Third and later events from the tables, by states among lines of sight and beams of light, drawn by a guess of their light.

A path of three and more events in a body is one edge: from a place on a beam of light that came in to a place on a line of
sight, by the table of its medium.  Lines of sight and beams of a pass are drawn first, as for other methods with tables
(`transport`, `light`), negative beams among them, several paths a pixel.  States are six numbers: which line, which beam, where
on each, and where light of negative beams scatters that has two events.

Of many candidates for states, which a guide draws evenly among lines, some are drawn by a guess of what they bring over their
density, and only these are looked up in the tables (sampling, importance resampling: Rubin 1987; Talbot, Cline and Egbert 2005).
That is how chains of Metropolis's algorithm begin without bias (Veach and Guibas 1997, section 5.1); but the guess is so near
that steps from there gain nothing.  Beams that take light away are drawn after the others, so that chance does not decide how
many of either sign there are.

The guide knows parts of the lists of lines and of beams, and how much light each part of one brings to each of the other, as a
pilot has it; it is the same in all passes, so that none is biased.
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import NamedTuple

import numpy as np

from bakery.kernels import stream_key
from renderers.colour import LUMINANCE
from renderers.materials.bodies import _mutations, gather, light, smooth, surfaces, transport
from renderers.materials.bodies._gather import Beams
from renderers.materials.bodies._mutations import BINS, FINEST, IN_BIN, NUMBERS, Edge, Guess, Guide, Sights
from renderers.materials.bodies.bias import CLOSER
from renderers.materials.bodies.setup import Sums
from renderers.threads import run
from renderers.transport import wavefront
from renderers.transport.paths import follow, joined

_PATHS, _SAMPLES = 1 << 16, 64  # from the camera in a pass, about; of a pixel, at most
_VIEWS = 8  # of a pixel, at most, by which neighbours share
_FATES = 8  # of a path that enters a body and scatters: such lines bring a 28th of the light of glass, and were half of its noise
# Times the places and walks of other methods, which have lines of sight share few beams.  Of four times as many places wax has
# 0.72 to 0.87 of the variance in equal time, the bumpy ball 1.2 to 1.3
_BEAMS = 4
_OF_LINE = 8  # states that are looked up for a line of sight
_CANDIDATES = 10  # states drawn by the guide for each of them
_OF_PILOT = 1 << 20  # states drawn alike that tell the guide
_PARTS = 128, 128  # of lines and of beams, which the guide tells apart
_ALIKE, _CLIPPED = 0.3, 300.0  # share that it draws alike; of the mean, what one state counts at most
# Of a part's mean square, what its neighbours have, too: 64 states of the pilot tell little of a bright pair.  A candle has 0.72,
# wax in glass 0.76 of the variance; single candidates 5,400 times the mean in place of 9,400
_OF_NEIGHBOURS = 0.5
# of a sequence of low discrepancy in so many dimensions (Roberts 2018): powers of the inverse root of x^(d+1) = x + 1
_LATTICE = 1.1347241384015194 ** -np.arange(0.0, NUMBERS)
_IN_PIXEL = 1.3247179572447460 ** -np.arange(1.0, 3.0)  # the same in two
_TOGETHER = 1 << 18  # candidates that are kept at once
_ALL = 1 << 15  # paths of the camera that go on together, and several that scatter of each


class Settings(NamedTuple):
    """Of a pass.

    boundary : whether light that leaves is taken away (negative beams)
    second : of each body, whether second events are gathered, too
    most : of each body, events between two surfaces that a path of the camera may have
    beyond : of each body (L,) m, distance of a mirror outside of its boundary; inf where there is none
    places, walks : where light comes in, and of light
    """

    boundary: bool
    second: list
    most: list
    beyond: list
    places: int
    walks: int


class Mutations:
    """Passes of states: called with the number of a pass, it gives its layers."""

    def __init__(self, setup, entries, settings, seed):
        """
        Parameters
        ----------
        setup : `setup.Transport`;  settings : `Settings`;  seed : of the random numbers of all passes
        entries : function that gives `light.Entries` of each body, of which the first pass asks
        """
        self._setup, self._entries, self._settings, self._seed = setup, entries, settings, seed
        self._size, self._pixels = setup.world.size, setup.world.size[0] * setup.world.size[1]
        # a pilot has as many of a pixel as the picture that it is one of, so that its noise is that of this
        whole = self._pixels if setup.world.whole is None else max(self._pixels, math.prod(setup.world.whole.size))
        self._samples = max(1, min(_SAMPLES, _PATHS // whole))
        self._states = {}

    def __call__(self, number):
        views, gathers = self._seen(number, self._seed)
        image, self._states[number] = np.zeros((3, self._pixels, 3)), 0
        lines = self._lines(number, self._seed, gathers)
        for group in self._groups(number, self._seed, lines):
            group.bring(self._guides[group.body], image)
            self._states[number] += group.count
        return self._layers(number, image, gathers, views, self._cover(lines))

    @property
    def count(self) -> int:
        """States that the passes so far have drawn."""
        return sum(self._states.values())

    def noisier(self, passes) -> float:
        """Variance of the last of so many passes over that of one that shares over the whole distance."""
        return smooth.noisier(passes, self._samples, smooth.FULL, self._spares)

    def _seen(self, number, seed):
        """What the camera sees of bodies in a pass, as often as it samples a pixel, and pixels (H, W) that gather light."""
        keys = [stream_key(seed, "render.views", number, view) for view in range(min(self._samples, _VIEWS))]
        views = [smooth.seen(self._setup, transport.begin(self._setup, np.arange(self._pixels), key)) for key in keys]
        return views, smooth.chosen(views[0], number) if self._spares else np.ones(self._size, bool)

    @property
    def _spares(self):
        """Whether one of four pixels gathers for all."""
        return self._samples == 1 and not any(self._settings.second)

    def _layers(self, number, image, gathers, views, cover):
        later, second, third = (values.reshape(*self._size, 3) for values in image)
        share = smooth.falling(self._samples * (number + 1), self._spares, smooth.FULL)
        half, later = (self._smoothed(later, gathers, views, part * share, cover) for part in (0.5, 1.0))
        none = np.zeros_like(later)
        return {"": later + second + third, "order0": none, "order1": none, "order2": second, "orders": later + third,
                CLOSER[number % 2]: half - later}

    def _smoothed(self, image, gathers, views, share, cover):
        """Mean of the views of each pixel that see a body: which pixels share depends on where in each the camera looks, and of
        one view that was half of the noise of a bumpy ball."""
        shared = np.array([smooth.smoothed(image, gathers, view, share, cover) for view in views])
        sees = np.array([view.body >= 0 for view in views])[..., None]
        return np.where(sees.any(axis=0), (shared * sees).sum(axis=0) / np.maximum(sees.sum(axis=0), 1), image)

    def _cover(self, lines):
        """(H, W) how much of each pixel its lines of sight see that have not scattered, by the share of them that collides; None
        where some pixels have none.

        At outlines, and where bodies are thin, this changes from pixel to pixel, and light over it is smooth.
        """
        if self._spares:
            return None
        cover = np.zeros(self._pixels)
        for body, its in lines.items():
            collides = -np.expm1(-self._setup.bodies[body].medium.sigma_t * its.far[:, None])
            cover += np.bincount(its.pixel, np.where(its.order > 0, 0.0, (its.throughput * collides).mean(axis=1)), self._pixels)
        return cover.reshape(self._size)

    @cached_property
    def _guides(self):
        """`Guide` of each body, by states drawn alike."""
        guides = [guide_of(np.ones((1, 1)))] * len(self._setup.bodies)
        seed = stream_key(self._seed, "render.mutations_pilot")
        for group in self._groups(0, seed, self._lines(0, seed, self._seen(0, seed)[1])):
            guides[group.body] = group.pilot()
        return guides

    @cached_property
    def _guesses(self):
        """`Guess` of each body."""
        return [_guess_of(body, self._setup.colours.to_rgb) for body in self._setup.bodies]

    def _groups(self, number, seed, lines):
        """`_Group` of each body in which there are lines of sight, of `_lines`, and beams, in a pass."""
        asked = self._settings
        beams = light.beams(self._setup, self._entries(), _BEAMS * asked.places, _BEAMS * asked.walks, asked.boundary, False,
                            number, seed)
        for body, its in lines.items():
            if its.count and len(beams[body].length):
                among = _Among(self._edge(body), self._guesses[body], self._sights(body, its), _by_sign(beams[body]))
                yield _Group(body, among, stream_key(seed, "render.mutations", number, body))

    def _lines(self, number, seed, gathers):
        """`Paths` of each body that are lines of sight in it, in a pass."""
        setup, asked, collected = self._setup, self._settings, _Collected()
        pixels, sums = np.flatnonzero(gathers), Sums(self._pixels, by_paths=False)
        shift = wavefront.uniforms(wavefront.streams(stream_key(seed, "render.sights", number), len(pixels)), 2)
        key = stream_key(seed, "render.lines", number)

        def camera(first, last):
            which, sample = np.divmod(np.arange(first, last), self._samples)
            places = (shift[which] + sample[:, None] * _IN_PIXEL) % 1.0
            paths = transport.begin(setup, pixels[which], key, first, places)
            paths.throughput[:] *= _FATES  # so that roulette leaves as many of each
            return paths

        follow(len(pixels) * self._samples, _ALL, camera,
               lambda paths: transport.onward(setup, paths, asked.most, sums, collected, _FATES))
        return {body: joined(parts) for body, parts in sorted(collected.parts.items())}

    def _sights(self, body, lines):
        """`Sights` of paths in a body: those that have not scattered before others."""
        order = gather.by_place(lines.origin, self._setup.bodies[body].vertices)
        lines = lines.of(order[np.argsort(~lines.seen[order], kind="stable")])
        # those of a pixel are neighbours, so that chance does not decide how many states it has; those that have scattered are
        # anywhere in the body, and the guide tells apart where
        _, first, pixel = np.unique(lines.pixel, return_index=True, return_inverse=True)
        scattered = lines.order > 0
        lines = lines.of(np.lexsort([np.where(scattered, 0, first[pixel]), scattered]))
        mirrored = np.isfinite(self._settings.beyond[body]).any()
        facing = surfaces.facing(self._setup, lines) if mirrored else np.empty((0, 3))
        weight = lines.throughput / (_FATES * self._samples)
        return Sights(lines.origin, lines.direction, lines.far, facing, weight, lines.pixel, lines.order)

    def _edge(self, number):
        body, asked = self._setup.bodies[number], self._settings
        return Edge(self._setup.geometry, body.medium, tuple(points for points, _ in body.tables), asked.beyond[number],
                    asked.second[number], self._setup.colours.to_rgb)


class _Collected:
    """Lines of sight, as a pass comes to them (called as `gather.Gather`); parts : of each body."""

    def __init__(self):
        self.parts = {}

    def __call__(self, setup, paths, number, sums):
        self.parts.setdefault(number, []).append(gather.sights(paths)[1])


def _by_sign(beams):
    """Beams that bring light before those that take it away, each in their order."""
    order = np.argsort(beams.power.sum(axis=1) < 0, kind="stable")
    return Beams(*(np.ascontiguousarray(values[order]) for values in beams))


def guide_of(luminance):
    """`Guide` by odds of parts (I, B), some of all alike; alike altogether where there are none."""
    mean = luminance.mean()
    density = (1 - _ALIKE) * luminance / mean + _ALIKE if mean > 0 else np.ones_like(luminance)
    lines, beams = density.mean(axis=1), density / density.sum(axis=1, keepdims=True)
    lines = np.append(0.0, np.cumsum(lines) / lines.sum())
    beams = np.concatenate([np.zeros((len(beams), 1)), np.cumsum(beams, axis=1)], axis=1)
    lines[-1] = beams[:, -1] = 1.0
    return Guide(lines, beams, density)


def _guess_of(body, to_rgb):
    """`Guess` of what the tables of a body have."""
    tables = [points for points, _ in body.tables]
    across, sigma = np.linalg.norm(np.ptp(body.vertices, axis=0)), body.medium.sigma_t
    scale, values = 1 / np.log1p(across * sigma.min() / FINEST), np.empty((*BINS, len(tables)), np.float32)
    shifts = (np.arange(IN_BIN)[:, None] * _LATTICE[:4] + 0.5) % 1.0
    for w, table in enumerate(tables):
        _mutations.averaged(table, sigma[w] / sigma.min(), scale, shifts, values[..., w])
    return Guess(LUMINANCE @ np.abs(to_rgb), scale, values, *[np.empty((0, 0), np.float32)] * 2)


class _Among(NamedTuple):
    """What states in a body are among."""

    edge: Edge
    guess: Guess
    sights: Sights
    beams: Beams


class _Group:
    """States in a body, of a pass.

    body : its number;  count : of candidates
    """

    def __init__(self, body, among, key):
        sights, beams, sigma = among.sights, among.beams, among.edge.medium.sigma_t.min()
        guess = among.guess._replace(
            lines=_mutations.ends_of(sigma, sights.origin, sights.direction, sights.far, sights.weight),
            beams=_mutations.ends_of(sigma, beams.origin, beams.direction, beams.length, beams.power))
        self.body, self._among, self._stream = body, among._replace(guess=guess), wavefront.streams(key, 1)
        self._looked = _OF_LINE * len(among.sights.far)
        self.count = _CANDIDATES * self._looked

    def pilot(self):
        """A `Guide` by what states drawn alike are guessed to bring, root mean square."""
        from scipy.ndimage import uniform_filter

        states, worth = self._drawn(guide_of(np.ones((1, 1))), 0, _OF_PILOT, _OF_PILOT)
        number = np.minimum((states[:, :2] * _PARTS).astype(int), np.array(_PARTS) - 1) @ [_PARTS[1], 1]
        count = np.bincount(number, minlength=math.prod(_PARTS))
        square = np.bincount(number, np.minimum(worth, _CLIPPED * worth.mean()) ** 2, math.prod(_PARTS))
        square = (square / np.maximum(count, 1)).reshape(_PARTS)
        return guide_of(np.sqrt((1 - _OF_NEIGHBOURS) * square + _OF_NEIGHBOURS * uniform_filter(square, 3)))

    def bring(self, guide, image):
        """Adds what states bring to image (3, pixels, 3)."""
        for first in range(0, self._looked, _TOGETHER // _CANDIDATES):
            last = min(first + _TOGETHER // _CANDIDATES, self._looked)
            states, worth = self._drawn(guide, _CANDIDATES * first, _CANDIDATES * last, self.count)
            self._look_up(guide, states, worth, last - first, image)

    def _drawn(self, guide, first, last, n):
        """Candidates first to last of n, which the guide draws from a lattice of numbers, moved by chance, by their lines; and
        what is guessed of each over its density."""
        shift, number, worth = wavefront.uniforms(self._stream, NUMBERS), np.arange(first, last), np.empty(last - first)
        states = number[:, None] * _LATTICE + shift
        states -= np.floor(states)
        states[:, 0] = np.minimum((number + shift[0, 0]) / n, 1 - 2.0**-53)
        run(_mutations.candidates, len(states), *self._among, guide, states, worth)
        return states, worth

    def _look_up(self, guide, states, worth, count, image):
        """Adds what so many of the states bring, drawn by their worth, those with beams that take light away after the others."""
        edge, guess, sights, beams = self._among
        takes = beams.power.sum(axis=1) < 0
        order = np.argsort(takes[np.minimum((states[:, 1] * len(takes)).astype(int), len(takes) - 1)], kind="stable")
        number, added = wavefront.uniforms(self._stream, 1), np.cumsum(worth[order])
        if not added[-1] > 0:
            return
        along = (np.arange(count) + number[0, 0]) / count * added[-1]
        at = np.minimum(np.searchsorted(added, along, side="right"), np.flatnonzero(worth[order])[-1])
        chosen = order[at]
        states, light, odds = states[chosen], np.empty((count, 3, 3)), np.empty(count)
        numbers = np.clip(1 - (added[at] - along) / worth[chosen], 0.0, 1.0)
        run(_mutations.settle, count, edge, guess, sights, beams, numbers, states, odds)
        run(_mutations.bring, count, edge, sights, beams, guide, states,
            added[-1] / (count * self.count * worth[chosen] * odds), light, block=256)
        _mutations.add(sights, states, light, image)
