"""Pictures by Metropolis's algorithm over primary samples (Kelemen et al. 2002), thousands of chains at once.

A chain is a path that moves from one to another, so that it is at each as often as goes with the luminance of its light (the
absolute value of it): `primary` holds the numbers that it is made of.  Small steps move all of them a little, some with a new
random stream behind; large steps draw all anew.

Each pass is a group of chains by itself, so that the scatter of passes is the noise of the picture, although neighbouring pixels
of a pass share theirs.  It begins with paths drawn alike, candidates, from which the chains begin by their luminance: weighted
with the mean luminance of the candidates, which is the normalisation, every step of a chain has the right mean, the first as the
last (Veach and Guibas 1997, section 5.1).  So nothing is to be thrown away at the start, and no pass is biased.

Candidates and large steps are paths drawn alike, too.  What they bring and what chains bring are two estimates of the same, each
weighted where it is better by the balance heuristic (Kelemen et al. 2002, section 4), whose densities are from pilots, alike in
all passes: they do not go with what a pass finds.
"""

import math
from functools import cached_property
from typing import NamedTuple

import numpy as np

from bakery.kernels import stream_key
from renderers.pictures.engine import Part, layers_of
from renderers.transport import _metropolis, primary, wavefront
from renderers.transport.wavefront import ORDERS

# paths of a pass: at most, at least; in between so many a pixel.  Dr.Jit traces each step anew, a sixth of the time of 2^18 paths
_PATHS, _FEWEST, _SAMPLES = 1 << 20, 1 << 19, 16
_STEPS, _LARGE = 12, 4  # of a chain; of so many the last one is large
_TURNS, _OF_TURN = 8, 12  # turns of a path whose numbers stand in a table, and how many each takes at most
_EFFECTIVE = 0.25  # independent paths that a step of a chain is worth, as the weights count it
_PILOTS = 16  # passes of candidates until one finds light, at most


class Group(NamedTuple):
    """Chains of a pass: candidates from which they begin, how many they are, and steps of each."""

    candidates: int
    chains: int
    steps: int

    @classmethod
    def of(cls, pixels, samples=None):
        """For a picture of so many pixels, or one with so many samples of each."""
        paths = samples * pixels if samples else max(pixels, min(_PATHS, max(_FEWEST, _SAMPLES * pixels)))
        chains = math.ceil(paths / (_STEPS + _LARGE))
        return cls(_LARGE * chains, chains, _STEPS)

    @property
    def paths(self):
        """That are followed."""
        return self.candidates + self.chains * self.steps

    @property
    def drawn(self):
        """Paths that are drawn alike: candidates and large steps."""
        return self.candidates + self.chains * (self.steps // _LARGE)

    @property
    def moved(self):
        """States of chains, counted as so many independent ones."""
        return _EFFECTIVE * self.chains * self.steps


class Figures(NamedTuple):
    """normalisation : mean luminance of the picture as candidates have it, None before there is one
    error : its standard error, by the scatter of passes, None of one
    small_steps, large_steps : shares of steps that chains have taken, None where none began
    """

    normalisation: float | None
    error: float | None
    small_steps: float | None
    large_steps: float | None

    @classmethod
    def of(cls, normalisations, accepted) -> "Figures":
        """Of passes by their number: mean luminance of candidates, and shares of small and large steps of those that have any."""
        values, taken = np.array(list(normalisations.values())), np.array(list(accepted.values()))
        error = float(values.std(ddof=1) / len(values) ** 0.5) if len(values) > 1 else None
        return cls(float(values.mean()) if len(values) else None, error,
                   *(taken.mean(axis=0).tolist() if len(taken) else (None, None)))


class States(NamedTuple):
    """Where n chains are: light (n, 3 ORDERS), its luminance (n,) and pixel (n,); `Table` of numbers, words (2, n) of streams."""

    light: np.ndarray
    luminance: np.ndarray
    pixel: np.ndarray
    table: primary.Table | None
    words: np.ndarray


class Metropolis:
    """Passes of chains: called with the number of a pass, it gives its layers.

    group : `Group`
    size : height and width, pixels
    """

    def __init__(self, light, size, seed, luminance, samples=None):
        """
        light : function of a `primary.Source` -> light (n, 3 ORDERS) of its paths, and their pixels (n,)
        size : height and width, pixels
        seed : of the random numbers of all passes
        luminance : (3,) of linear sRGB
        samples : of a pixel; None: as many as a picture of that size has
        """
        self._light, self.size, self._seed, self._to_luminance = light, size, seed, luminance
        self.group = Group.of(size[0] * size[1], samples)
        self._normalisations, self._accepted = {}, {}

    def __call__(self, number):
        pixels = self.size[0] * self.size[1]
        by_order = np.zeros((ORDERS, pixels, 3))
        light, pixel, words, streams = self._candidates(stream_key(self._seed, "render.metropolis", number))
        candidates = States(light, self._luminance(light), pixel, None, words)
        _metropolis.bring(candidates.light, candidates.pixel, self._of_drawn(candidates.luminance), by_order)
        normalisation = float(candidates.luminance.mean())
        self._normalisations[number] = normalisation
        if normalisation > 0:
            self._accepted[number] = self._moved(self._from_candidates(candidates, streams), streams, normalisation, by_order)
        return layers_of((pixels * by_order).reshape(ORDERS, *self.size, 3))

    def figures(self) -> Figures:
        """Of the passes so far."""
        return Figures.of(self._normalisations, self._accepted)

    def _candidates(self, key):
        """Light, pixels and words of a pass's candidates, and random streams (chains + 1,) of what follows."""
        states = wavefront.streams(key, self.group.chains + 1 + self.group.candidates)
        pixel, words = self._places(states[self.group.chains + 1:], 0.0)
        return *self._light(primary.Source(self.size, pixel, words)), words, states[:self.group.chains + 1]

    def _places(self, states, shift):
        """Pixels (n,), spread evenly over the picture but for a shift, 0 to 1 of it, and words (2, n) of streams."""
        n, pixels = len(states), self.size[0] * self.size[1]
        numbers = wavefront.uniforms(states, 3)
        share = ((np.arange(n) + numbers[:, 0]) / n + shift) % 1.0
        return np.minimum((share * pixels).astype(np.uint32), pixels - 1), (numbers[:, 1:].T * 2.0**32).astype(np.uint32)

    def _from_candidates(self, candidates, streams):
        """Chains at candidates that are drawn by their luminance, evenly."""
        n, number = self.group.chains, wavefront.uniforms(streams[:1], 1)
        added = np.cumsum(candidates.luminance)
        chosen = np.searchsorted(added, (np.arange(n) + number[0, 0]) / n * added[-1], side="right")
        chosen = np.minimum(chosen, np.flatnonzero(candidates.luminance)[-1])
        light, luminance, pixel, words = (values[chosen] for values in (candidates.light, candidates.luminance, candidates.pixel,
                                                                    candidates.words.T))
        table = primary.Source(self.size, pixel, words.T).drawn(primary.FILM + _TURNS * _OF_TURN)
        return States(light, luminance, pixel, table, words.T.copy())

    def _moved(self, chains, streams, normalisation, by_order):
        """Moves chains and adds what they bring; shares of small and of large steps that they took."""
        of_state, taken = normalisation / (self.group.chains * self.group.steps), [[], []]
        for step in range(1, self.group.steps + 1):
            large = step % _LARGE == 0
            proposed = self._proposed(chains, streams, large, new=step % _LARGE == 2)
            accepted = np.minimum(proposed.luminance / chains.luminance, 1.0)
            numbers = wavefront.uniforms(streams[1:], 1)
            for states, share in ((chains, 1 - accepted), (proposed, accepted)):
                _metropolis.bring(states.light, states.pixel, share * of_state * self._of_moved(states.luminance), by_order)
            if large:
                _metropolis.bring(proposed.light, proposed.pixel, self._of_drawn(proposed.luminance), by_order)
            chains = self._taken(numbers[:, 0] < accepted, proposed, chains)
            taken[large].append(accepted.mean())
        return [float(np.mean(shares)) if shares else 0.0 for shares in taken]

    def _proposed(self, chains, streams, large, new):
        """Where chains may go; new: with a new random stream behind the table."""
        numbers = wavefront.uniforms(streams[:1], 3)
        pixel, words = self._places(streams[1:], numbers[0, 0])
        if large:
            light, pixel = self._light(primary.Source(self.size, pixel, words))
            return States(light, self._luminance(light), pixel, None, words)
        table = primary.moved(chains.table, self.size, (numbers[0, 1:] * 2.0**32).astype(np.uint32).tolist())
        words = words if new else chains.words
        light, pixel = self._light(primary.Source(self.size, pixel, words, table))
        return States(light, self._luminance(light), pixel, table, words)

    def _taken(self, accepted, proposed, chains):
        """Chains after a step."""
        table = proposed.table or primary.Source(self.size, proposed.pixel, proposed.words).drawn(chains.table.count)
        light, luminance, pixel, words = (np.where(accepted.reshape(-1, *[1] * (new.ndim - 1)), new, old) for new, old in (
            (proposed.light, chains.light), (proposed.luminance, chains.luminance), (proposed.pixel, chains.pixel),
            (proposed.words.T, chains.words.T)))
        return States(light, luminance, pixel, primary.either(accepted, table, chains.table), words.T.copy())

    def _luminance(self, light):
        """(n,) of light (n, 3 ORDERS), as chains go by it."""
        value = np.abs(np.einsum("nk,k->n", light, np.tile(self._to_luminance, ORDERS)))
        return np.where(np.isfinite(value), value, 0.0)

    @cached_property
    def _typical(self):
        """Mean luminance of the picture by the first candidates that find light; 0 where none do."""
        keys = (stream_key(self._seed, "render.metropolis_pilots", number) for number in range(_PILOTS))
        means = (float(self._luminance(self._candidates(key)[0]).mean()) for key in keys)
        return next((mean for mean in means if mean > 0), 0.0)

    def _of_drawn(self, luminance):
        """Shares (n,) that count of paths that are drawn alike."""
        if not self._typical > 0:
            return (luminance == 0) / self.group.drawn
        return 1 / (self.group.drawn + self.group.moved * luminance / self._typical)

    def _of_moved(self, luminance):
        """The same of states of chains, over their luminance."""
        with np.errstate(divide="ignore"):
            if not self._typical > 0:
                return np.where(luminance > 0, 1 / luminance, 0.0)
        return self.group.moved / (self._typical * self.group.drawn + self.group.moved * luminance)


def part(name, world, entries, colours, seed, luminance) -> Part:
    """Passes of chains of paths, which `renderers.transport.passes.part` would draw alike; parameters as there.

    luminance : (3,) of linear sRGB, which chains go by

    The part's `render` is a `Metropolis`.
    """
    scene = []

    def light(source):
        if not scene:
            from renderers.transport.scene import Scene

            scene.append(Scene.of_bodies(world, entries, colours))  # with the first pass
        return primary.light(scene[0], source)

    if world.whole is None:
        return _of_chains(name, Metropolis(light, world.size, seed, luminance))

    # Each path of a pilot brings as much variance as in the picture, however many chains there are: by few of a pixel, as large
    # pictures have, neither what they cost nor how far the brightest go would be known
    def with_samples(samples):
        return _of_chains(name, Metropolis(light, world.size, seed, luminance, samples))._replace(fewer=with_samples)

    return with_samples(_SAMPLES)


def _of_chains(name, chains) -> Part:
    pixels = chains.size[0] * chains.size[1]
    return Part(name, chains, max(1, chains.group.paths // pixels), steps=_STEPS)
