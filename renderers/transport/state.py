"""What a pass of the loop carries: its paths, what they come to, the functions of a turn, and its numbers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import drjit as dr

from renderers.transport.airlight import Before, Stretch
from renderers.transport.lamps import Departure
from renderers.transport.records import Counts
from renderers.transport.rough import Entry
from renderers.transport.strata import Strata
from renderers.transport.wide import Chance

import mitsuba as mi  # isort: skip

_TURN = (5**0.5 - 1) / 2  # of all lanes, by which their pixels move


@dataclass
class Path:
    """Paths, one a lane.

    random : PCG32;  pixel, number : of the path;  alive : whether there is one
    origin, direction : of the next flight;  throughput : of each wavelength
    squared_index : of where it is over that around the camera, by which refraction has divided the throughput
    inside : bodies in which it is, a bit each, the innermost one first
    order, bounces : scatterings in bodies; those and surfaces
    since : scatterings since the last surface, where the scene limits them; else None
    drawn, density : where the direction was drawn, and its density (1/sr);  single : no light sample could have found it
    choice : uniform number, of what the first smooth boundary does
    departure, chance : since the last scattering, where small lamps are sampled through smooth boundaries, and where wide ones
        are; entry : the same, where lamps are sampled through rough ones; else None
    before : `airlight.Before`, where paths may meet lamps for which light samples are taken along flights; else None
    counts : of records of the lane, where either is
    """

    random: mi.PCG32
    pixel: mi.UInt32
    number: mi.UInt32
    alive: mi.Bool
    origin: mi.Point3f
    direction: mi.Vector3f
    throughput: list
    squared_index: mi.Float
    inside: mi.UInt32
    order: mi.UInt32
    bounces: mi.UInt32
    since: mi.UInt32 | None
    drawn: mi.Point3f
    density: mi.Float
    single: mi.Bool
    choice: mi.Float
    departure: Departure | None
    chance: Chance | None
    entry: Entry | None
    before: Before | None
    counts: Counts | None


@dataclass
class Event:
    """What paths have come to.

    scatters : a scattering in `medium`, at `position`, that light samples reach
    meets : a surface;  misses : nothing, but for the environment;  surface : interaction with either
    crosses : that surface is a boundary to which light is blind
    opaque : that surface is one of `far.FarSurfaces`, and the path is turned there; None where there are none
    stretch : of the flight to there, along which a light sample is taken; None where none is
    """

    scatters: mi.Bool
    medium: mi.UInt32
    position: mi.Point3f
    meets: mi.Bool
    misses: mi.Bool
    surface: mi.SurfaceInteraction3f
    crosses: mi.Bool
    opaque: mi.Bool | None = None
    stretch: Stretch | None = None


class Turn(NamedTuple):
    """One turn of the loop, as functions of the scene and the paths.

    begin : the paths of the camera as this kind of turn has them
    advance : paths after a flight, and their events, which have at least meets, misses and surface of an `Event`
    next_event : light of light samples, linear sRGB, and its emitters
    turned : paths that go on
    """

    begin: Callable
    advance: Callable
    next_event: Callable
    turned: Callable


class Numbers(NamedTuple):
    """Numbers of a pass as variables: they would be part of the kernel, and others another kernel.

    pixels, lanes : of the pass;  strata : of the samples of a pixel
    """

    pixels: mi.UInt32
    lanes: mi.UInt32
    strata: Strata

    @property
    def key(self) -> list:
        """Two numbers of 32 bits, of the random stream."""
        return self.strata.key

    @property
    def samples(self) -> mi.UInt32:
        """Of a pixel."""
        return self.strata.count

    @property
    def turn(self) -> mi.UInt32:
        """By how many lanes pixels move from one row of as many pixels to the next."""
        return mi.UInt32(mi.Float(self.lanes) * _TURN)

    @classmethod
    def of(cls, key, pixels, lanes, samples) -> Numbers:
        """Of a pass of so many samples of each pixel."""
        return cls(*(dr.opaque(mi.UInt32, number) for number in (pixels, lanes)), Strata.of(key, samples))

    @classmethod
    def from_list(cls, numbers) -> Numbers:
        """Of what `to_list` gives: recordings take lists."""
        pixels, lanes, first, second, count, columns = numbers
        return cls(pixels, lanes, Strata([first, second], count, columns))

    def to_list(self) -> list:
        """All of its variables."""
        return [self.pixels, self.lanes, *self.strata.key, self.strata.count, self.strata.columns]
