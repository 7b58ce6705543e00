"""Every random stream by name: (seed, name, index) gives its generator.

A stream's word is part of what its numbers are made of, and a name is never used for something else; so two streams never share
numbers, whatever the seeds.  A stage whose stream changes changes its values: its version goes up.
"""

from typing import NamedTuple

import numpy as np


class Stream(NamedTuple):
    """A stream's own 32-bit word, and what each of its indices counts."""

    word: int
    index: tuple[str, ...]


STREAMS = {
    "shapes": Stream(0x67726169, ("part of the shape",)),
    "packing.centers": Stream(0x7061636B, ("tile", "attempt")),
    "packing.chords": Stream(0x63686F72, ("block",)),
    "grains.entries": Stream(0x656E7472, ("walk", "replicate")),
    "grains.walk": Stream(0x77616C6B, ("walk",)),
    "granular.walk": Stream(0x6772616E, ()),
    "surface.probes": Stream(0x70726F62, ()),
    "surface.spread": Stream(0x73707264, ("wavelength", "layer", "block")),
    "granular.goniometer": Stream(0x676F6E69, ("group of wavelengths",)),
    "multiple.photons": Stream(0x70686F74, ("block",)),
    "multiple.tally": Stream(0x74616C79, ("batch", "block")),
    "multiple.places": Stream(0x706C6163, ("kind of source",)),
    "multiple.fit": Stream(0x66697473, ()),
    "multiple.compare": Stream(0x636F6D70, ()),
    "beam.photons": Stream(0x6265616D, ("wavelength", "block")),
    "beam.small_angle": Stream(0x616E676C, ("block",)),
    "discrete.numbers": Stream(0x6E756D62, ()),
    "discrete.slabs": Stream(0x736C6162, ("class", "attempt")),
    "discrete.places": Stream(0x64706C63, ("class", "slab", "attempt")),
    "discrete.extra": Stream(0x65787472, ("class", "attempt")),
    "discrete.cells": Stream(0x63656C6C, ()),
    "render.grains": Stream(0x72677261, ("light before or after the switch", "pass")),
    "render.chords": Stream(0x72636872, ()),
    "render.clear": Stream(0x72636C65, ()),
    "render.walk": Stream(0x7277616C, ("pass",)),
    "render.mixed": Stream(0x726D6978, ("pass",)),
    "render.mitsuba": Stream(0x726D6974, ("pass",)),
    "render.splat": Stream(0x7273706C, ("pass", "chunk")),
    "render.aims": Stream(0x7261696D, ()),
    "render.places": Stream(0x72706C63, ()),
    "render.choices": Stream(0x7263686F, ()),
    "render.blocks": Stream(0x72626C6B, ()),
    "render.detail": Stream(0x72646574, ()),
    "render.depths": Stream(0x72647074, ()),
    "render.branch": Stream(0x72627261, ()),
    "render.seen": Stream(0x7273656E, ()),
    "render.translucent": Stream(0x7274726E, ("pass",)),
    "render.gathered": Stream(0x72677468, ("pass",)),
    "render.joined": Stream(0x726A6F69, ("pass",)),
    "render.paths": Stream(0x72707468, ("pass",)),
    "render.metropolis": Stream(0x726D7470, ("pass",)),
    "render.metropolis_pilots": Stream(0x726D7069, ("pilot",)),
    "render.mutations": Stream(0x726D7574, ("pass", "body")),
    "render.mutations_pilot": Stream(0x726D7570, ()),
    "render.sights": Stream(0x72736774, ("pass",)),
    "render.lines": Stream(0x726C696E, ("pass",)),
    "render.views": Stream(0x72766965, ("pass", "view of a pixel")),
    "render.materials": Stream(0x726D6174, ("sample",)),
    "render.features": Stream(0x72666561, ()),
    "render.entries": Stream(0x72656E74, ("pass", "body")),
    "render.entries_pilot": Stream(0x72656E70, ("round", "body")),
    "render.beams": Stream(0x7262656D, ("pass", "body")),
    "render.lamps": Stream(0x726C6D70, ("pass", "lamp")),
    "render.lamps_tried": Stream(0x726C7472, ()),
    "render.guides": Stream(0x72677569, ()),
    "render.distances": Stream(0x72647374, ("kind of direction",)),
    "render.solid_angles": Stream(0x72736C61, ("lamp",)),
    "render.chains": Stream(0x7263686E, ("pass", "lamp")),
    "render.chains_entries": Stream(0x72636865, ("pass", "body")),
    "render.shares": Stream(0x72736872, ("pass",)),
    "render.light": Stream(0x726C6774, ("pass",)),
    "render.walks_pilot": Stream(0x72776C70, ()),
    "render.shells": Stream(0x7273686C, ("radius",)),
}
_WORD = 1 << 32


def sequence(seed: int, name: str, *index: int) -> np.random.SeedSequence:
    """What a stream's numbers are made of.

    Parameters
    ----------
    seed : 0 to 2^64 - 1
    name : one of `STREAMS`
    index : 0 to 2^32 - 1 each, as many as the stream has

    Raises
    ------
    KeyError : no such stream
    ValueError : a seed or an index out of range, or another number of indices
    """
    stream, seed = STREAMS[name], int(seed)
    if not 0 <= seed < _WORD**2 or len(index) != len(stream.index) or not all(0 <= int(i) < _WORD for i in index):
        raise ValueError(f"stream {name}: seed {seed}, index {index}; 0 to 2^64 - 1 and {len(stream.index)} whole numbers below "
                         "2^32 are possible")
    # NumPy cuts large numbers into words one after the other: a large seed's upper word apart, or it would pass for an index
    high = seed // _WORD
    return np.random.SeedSequence([stream.word, seed % _WORD, *map(int, index)], spawn_key=(high,) if high else ())


def generator(seed: int, name: str, *index: int) -> np.random.Generator:
    """The generator of a stream: Philox, counter-based; see `sequence`.

    >>> generator(0, "beam.photons", 1, 7).random() == generator(0, "beam.photons", 1, 7).random()
    True
    """
    return np.random.Generator(np.random.Philox(sequence(seed, name, *index)))


def key(seed: int, name: str, *index: int) -> np.ndarray:
    """Two 32-bit words for kernels that bring a counter-based generator of their own; see `sequence`."""
    return sequence(seed, name, *index).generate_state(2)


def stream_key(seed: int, name: str, *index: int) -> np.uint64:
    """The words of `key` as one of 64 bits, for kernels that hash it."""
    high, low = key(seed, name, *index)
    return np.uint64(high) << np.uint64(32) | np.uint64(low)
