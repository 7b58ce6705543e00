"""Third and later events from the tables, by Metropolis's algorithm among lines of sight and beams of light.

A path of three and more events in a body is one edge: from a place on a beam of light that came in to a place on a line of
sight, by the table of its medium.  Lines of sight and beams of a pass are drawn first, as for other methods with tables
(`transport`, `light`), negative beams among them, several paths a pixel.  States of chains are six numbers: which line, which
beam, where on each, and where light of negative beams scatters that has two events; neighbours are near each other in all of
them.  Chains go by the absolute value of the luminance, and what they bring keeps its sign.

Each pass is a group of chains by itself, with lines and beams of its own, so that the scatter of passes is the noise.  Chains
begin at states that a guide draws, by their luminance over its density, so that no start-up is thrown away and no pass is biased;
these and large steps, which it draws, too, share with the states of chains by the balance heuristic, as in
`renderers.transport.metropolis`.  The guide knows parts of the lists of lines and of beams, and how much light each part of one
brings to each of the other, as a pilot has it; it is the same in all passes.
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
from renderers.materials.bodies._mutations import NUMBERS, Chains, Edge, Guide, Plan, Sights
from renderers.materials.bodies.bias import CLOSER
from renderers.materials.bodies.setup import Sums
from renderers.threads import run
from renderers.transport import wavefront
from renderers.transport.metropolis import Figures
from renderers.transport.paths import follow, joined

_PATHS, _SAMPLES = 1 << 16, 64  # from the camera in a pass, about; of a pixel, at most
_BEAMS = 4  # times the places and walks of other methods, which have lines of sight share few beams
# mutations of a pass: so many a pixel, at least and at most; more where there are more lines of sight, so many of each
_OF_PIXEL, _FEWEST, _MOST_OF_PASS, _OF_LINE = 1024, 1 << 17, 1 << 21, 4
_STEPS, _LARGE = 256, 4  # of a chain; of so many the last one is large
_CANDIDATES = 16  # states drawn by the guide for each chain, to begin with
_OF_PILOT = 1 << 18  # states drawn alike that tell the guide
_PARTS = 64, 128  # of lines and of beams, which the guide tells apart
_ALIKE, _CLIPPED = 0.3, 30.0  # share that it draws alike; of the mean, what one state counts at most
# of a sequence of low discrepancy in so many dimensions (Roberts 2018): powers of the inverse root of x^(d+1) = x + 1
_LATTICE = 1.1347241384015194 ** -np.arange(0.0, NUMBERS)
_EFFECTIVE = 0.1  # independent states that a step of a chain is worth, as the weights count it
_BLOCKS, _MEMORY = 8, 1 << 22  # of chains, each with a picture of its own; pixels of them all, where that are fewer
_ALL = 1 << 17  # paths of the camera that go on together
_APART = 1 << 28  # random streams of bodies are so far apart
_PILOT = (1 << 30) - 1  # pass that finds how bright states are
_LATER = 1 << 31  # passes of lines of sight are numbered from here, so many of each pass
_MOST = 1 / 32  # of a small step, of the range of a number; least: a neighbour among lines and beams, and
_LEAST = 1 / 1024  # of places on them


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
    """Passes of chains: called with the number of a pass, it gives its layers."""

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
        self._mutations = max(_FEWEST, min(_MOST_OF_PASS, _OF_PIXEL * whole)) * self._pixels // whole
        self._normalisations, self._accepted, self._steps = {}, {}, {}

    def __call__(self, number):
        view, gathers = self._seen(number)
        image, luminance, steps, taken = np.zeros((3, self._pixels, 3)), 0.0, np.zeros(2), np.zeros(2)
        for group in self._groups(number, gathers, self._guides):
            of_body = group.begin(self._typical[group.body], image)
            luminance += of_body / gathers.sum()
            if of_body > 0:
                taken += group.move(image)
                steps = steps + group.count
        self._normalisations[number] = luminance
        self._steps[number] = int(np.sum(steps))
        if self._steps[number]:
            self._accepted[number] = (taken / steps).tolist()
        return self._layers(image, gathers, view)

    @property
    def count(self) -> int:
        """Mutations of the passes so far."""
        return sum(self._steps.values())

    def figures(self) -> Figures:
        """Of the passes so far."""
        return Figures.of(self._normalisations, self._accepted)

    def _seen(self, number):
        """What the camera sees of bodies in a pass, and pixels (H, W) that gather light."""
        rays = transport.begin(self._setup, np.arange(self._pixels), _LATER + number, self._seed)
        view = smooth.seen(self._setup, rays)
        shares = self._samples == 1 and not any(self._settings.second)
        return view, smooth.chosen(view, number) if shares else np.ones(self._size, bool)

    def _layers(self, image, gathers, view):
        later, second, third = (values.reshape(*self._size, 3) for values in image)
        half, later = smooth.smoothed(later, gathers, view, 0.5), smooth.smoothed(later, gathers, view)
        none = np.zeros_like(later)
        return {"": later + second + third, "order0": none, "order1": none, "order2": second, "orders": later + third,
                CLOSER: half - later}

    @property
    def _typical(self):
        """Luminance of all light in each body, by states drawn alike; 0 where none brings any."""
        return self._pilots[0]

    @property
    def _guides(self):
        """`Guide` of each body, by the same states."""
        return self._pilots[1]

    @cached_property
    def _pilots(self):
        """Both."""
        image, alike = np.zeros((3, self._pixels, 3)), guide_of(np.ones((1, 1)))
        count = len(self._setup.bodies)
        luminance, guides = [0.0] * count, [alike] * count
        for group in self._groups(_PILOT, self._seen(_PILOT)[1], guides):
            luminance[group.body], guides[group.body] = group.pilot(image)
        return luminance, guides

    def _groups(self, number, gathers, guides):
        """`_Group` of each body in which there are lines of sight and beams, in a pass."""
        asked = self._settings
        beams = light.beams(self._setup, self._entries(), _BEAMS * asked.places, _BEAMS * asked.walks, asked.boundary, False,
                            number, self._seed)
        lines = self._lines(number, gathers)
        total = sum(part.count for part in lines.values())
        for body, its in lines.items():
            if its.count and len(beams[body].length):
                steps = max(_OF_LINE * its.count, self._mutations * its.count // total)
                key = stream_key(self._seed, "render.mutations", number)
                among = _Among(self._edge(body), self._sights(body, its), _by_sign(beams[body]))
                yield _Group(body, among, guides[body], math.ceil(steps / _STEPS), key)

    def _lines(self, number, gathers):
        """`Paths` of each body that are lines of sight in it, in a pass."""
        setup, asked, collected = self._setup, self._settings, _Collected()
        pixels, sums = np.flatnonzero(gathers), Sums(self._pixels, by_paths=False)

        def camera(first, last):
            its = pixels[np.arange(first, last) // self._samples]
            return transport.begin(setup, its, _LATER + number, self._seed, first)

        follow(len(pixels) * self._samples, _ALL, camera,
               lambda paths: transport.onward(setup, paths, asked.most, sums, collected))
        return {body: joined(parts) for body, parts in sorted(collected.parts.items())}

    def _sights(self, body, lines):
        """`Sights` of paths in a body: those that the camera sees as they come first, then others."""
        order = gather.by_place(lines.origin, self._setup.bodies[body].vertices)
        lines = lines.of(order[np.argsort((lines.order + ~lines.seen)[order] > 0, kind="stable")])
        mirrored = np.isfinite(self._settings.beyond[body]).any()
        facing = surfaces.facing(self._setup, lines) if mirrored else np.empty((0, 3))
        weight = lines.throughput / self._samples
        return Sights(lines.origin, lines.direction, lines.far, facing, weight, lines.pixel, lines.order)

    def _edge(self, number):
        body, asked = self._setup.bodies[number], self._settings
        return Edge(self._setup.geometry, body.medium, tuple(points for points, _ in body.tables), asked.beyond[number],
                    asked.second[number], self._setup.colours.to_rgb, LUMINANCE)


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


class _Among(NamedTuple):
    """What chains in a body go among."""

    edge: Edge
    sights: Sights
    beams: Beams


class _Group:
    """Chains in a body, of a pass.

    body : its number;  count : (2,) small and large steps of all chains
    """

    def __init__(self, body, among, guide, chains, key):
        self.body, self._among, self._chains = body, among, chains
        self._streams = np.empty(chains + 2, np.uint64)
        wavefront.begin_streams(key, body * _APART, self._streams)
        large = _STEPS // _LARGE
        self.count = chains * np.array([_STEPS - large, large])
        lines, places = len(among.sights.far), len(among.beams.length)
        least = [min(1 / lines, _MOST), min(1 / places, _MOST), *[_LEAST] * (NUMBERS - 2)]
        small = np.array([[math.log(shortest / _MOST), _MOST] for shortest in least])
        self._plan = Plan(float(lines * places), _STEPS, _LARGE, small, float(_CANDIDATES * chains + self.count[1]),
                          float(_EFFECTIVE * chains * _STEPS), 0.0, 0.0, guide)

    def begin(self, typical, image) -> float:
        """Draws states by the guide and adds what they bring to image (3, pixels, 3): the luminance of all light in the body."""
        return self._drawn(_CANDIDATES * self._chains, typical, image)

    def pilot(self, image):
        """The luminance of all light in the body, by states drawn alike, and a `Guide` by what they bring."""
        mean = self._drawn(_OF_PILOT, 0.0, image)
        number = np.minimum((self._states[:, :2] * _PARTS).astype(int), np.array(_PARTS) - 1) @ [_PARTS[1], 1]
        count = np.bincount(number, minlength=math.prod(_PARTS))
        added = np.bincount(number, np.minimum(self._luminance, _CLIPPED * mean), math.prod(_PARTS))
        return mean, guide_of((added / np.maximum(count, 1)).reshape(_PARTS))

    def _drawn(self, n, typical, image):
        """Mean luminance of n states that the guide draws from a lattice of numbers, moved by chance."""
        self._luminance, shift = np.empty(n), np.empty((1, NUMBERS))
        wavefront.draw(self._streams[self._chains + 1:], shift)
        self._states = (np.arange(n)[:, None] * _LATTICE + shift) % 1.0
        self._states[:, 0] = np.minimum((np.arange(n) + shift[0, 0]) / n, 1 - 2.0**-53)
        self._plan = self._plan._replace(typical=float(typical))
        self._run(image, _mutations.candidates, self._states, self._luminance)
        return float(self._luminance.mean())

    def move(self, image):
        """Moves chains that begin at these states and adds what they bring; sums (2,) of how likely small and large steps were
        taken."""
        number, added = np.empty((1, 1)), np.cumsum(self._luminance)
        wavefront.draw(self._streams[:1], number)
        chosen = np.searchsorted(added, (np.arange(self._chains) + number[0, 0]) / self._chains * added[-1], side="right")
        chosen = np.minimum(chosen, np.flatnonzero(self._luminance)[-1])
        self._plan = self._plan._replace(of_state=float(self._luminance.mean() / (self._chains * _STEPS)))
        chains = Chains(self._states[chosen], self._streams[1:self._chains + 1], np.zeros((_BLOCKS, 2)))
        self._run(image, _mutations.move, chains)
        return chains.taken.sum(axis=0)

    def _run(self, image, kernel, *arguments):
        """Adds what a kernel brings, block by block of chains, whatever the threads."""
        kinds, pixels = 3 if self._among.edge.second else 1, image.shape[1]
        images = np.zeros((max(1, min(_BLOCKS, _MEMORY // pixels)), kinds, pixels, 3))
        run(kernel, len(images), *self._among, self._plan, *arguments, images, block=1)
        image[:kinds] += images.sum(axis=0)
