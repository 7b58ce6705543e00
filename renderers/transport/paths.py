"""Paths of a wavefront: the one record of their state, whichever material they are in, passed whole to compiled loops.

A path carries one throughput a wavelength and a random stream of its own.  Materials keep in it what they need from one call to
the next: which grain a path is on, which particle it has just left.
"""

from typing import NamedTuple

import numpy as np

from renderers import colour, threads
from renderers.transport import wavefront

# what a material has taken a path to: where it was to go, an event, nowhere, or another place, on its way
REACHED, EVENT, ENDED, ELSEWHERE = range(4)
UNKNOWN = -2  # in place of a grain's sphere: it is not known whether a path starts in one (`renderers.materials.grains._grains`)


class Colours(NamedTuple):
    """to_rgb : (3, L) linear sRGB from radiances;  to_waves : (L, 3) radiances from linear sRGB"""

    to_rgb: np.ndarray
    to_waves: np.ndarray

    @classmethod
    def of(cls, wavelength) -> "Colours":
        """From and to wavelengths (L,) um."""
        waves = np.asarray(wavelength, float)
        return cls(np.ascontiguousarray(colour.srgb_matrix(waves)), np.ascontiguousarray(colour.spread_matrix(waves)))


class Flying(NamedTuple):
    """What loops through media read and change of `Paths`."""

    origin: np.ndarray
    direction: np.ndarray
    throughput: np.ndarray
    states: np.ndarray
    order: np.ndarray
    bounces: np.ndarray
    drawn: np.ndarray
    density: np.ndarray


class Paths(NamedTuple):
    """n paths on their way; arrays are changed in place.  What a renderer does not need of them is None.

    origin, direction : (n, 3) m, unit;  throughput : (n, L);  states : (n,) uint64, random streams;  pixel : (n,)
    order, bounces : (n,) scatterings by materials; these and surfaces
    density : (n,) 1/sr, of the direction, over the chance of a light sample where it was drawn
    single : (n,) whether no light sample could have taken the place of the direction
    drawn : (n, 3) m, where the direction was drawn
    shaded : (n,) whether a surface of the scene, the camera, or a body whose boundary turns light drew it
    far : (n,) m, to the first surface of the scene, or what is of another body of grains; nan: not known
    grains : (n,) material whose grain each is on, or -1
    sphere, triangle : (n, 4), (n,) of that grain (`_grains.next_surface`)
    left_out : (n, 3) m, the particle that each has just left, or nan
    first : (n,) entry of the material that scattered it first, or -1

    Of scenes of bodies alone, where `far` and `triangle` are of the first triangle ahead (`_geometry.Geometry`):

    start : (n,) place of the triangle that each starts on, or -1
    events : (n,) since the last surface;  scattered : (n,) whether one of them drew the direction
    seen : (n,) whether the camera sees where they are, directly or by mirrors and panes
    rival : (n,) sr, after an event and up to the first light beyond the boundary: how likely beams are that bring the same
        (`_beams.rivals`); 0 where none do, inf where they are left to it

    Of scenes of particles alone:

    discrete : (n,) m, up to where particles stop the ray
    splatted : (n,) whether what `splat` takes of the path's next light is left out here
    ways : (n,) ways on from its next particle

    Of scenes of grains alone:

    body : (n,) in which each goes on, -1 where that is not known
    beyond : (n,) body in which `far` ends, -1 where it ends at a surface or nothing
    technique : (n,) GRAINS, MEDIUM or DIFFUSION (`_paths`)
    last, stage, switching : as in `_paths.Switching`
    centre : (n, 3) m, of the sphere that each starts in where its place is drawn; nan elsewhere
    """

    origin: np.ndarray
    direction: np.ndarray
    throughput: np.ndarray
    states: np.ndarray
    pixel: np.ndarray
    order: np.ndarray
    bounces: np.ndarray
    density: np.ndarray
    single: np.ndarray
    drawn: np.ndarray | None = None
    shaded: np.ndarray | None = None
    far: np.ndarray | None = None
    grains: np.ndarray | None = None
    sphere: np.ndarray | None = None
    triangle: np.ndarray | None = None
    left_out: np.ndarray | None = None
    first: np.ndarray | None = None
    start: np.ndarray | None = None
    events: np.ndarray | None = None
    scattered: np.ndarray | None = None
    seen: np.ndarray | None = None
    rival: np.ndarray | None = None
    discrete: np.ndarray | None = None
    splatted: np.ndarray | None = None
    ways: np.ndarray | None = None
    body: np.ndarray | None = None
    beyond: np.ndarray | None = None
    technique: np.ndarray | None = None
    last: np.ndarray | None = None
    stage: np.ndarray | None = None
    switching: np.ndarray | None = None
    centre: np.ndarray | None = None

    @classmethod
    def begun(cls, origin, direction, waves, states, pixel, **fields) -> "Paths":
        """Paths of the camera;  fields : those that only some renderers need: arrays, or one value of all."""
        n = len(pixel)
        fields = {name: value if isinstance(value, np.ndarray) else np.full(n, value) for name, value in fields.items()}
        return cls(origin, direction, np.ones((n, waves)), states, pixel, np.zeros(n, np.int64), np.zeros(n, np.int64),
                   np.zeros(n), np.ones(n, bool), **fields)

    def part(self, kind):
        """Those fields that a kind of named tuple has, without a copy: kernels take no more than they read."""
        return kind(*(getattr(self, name) for name in kind._fields))

    @property
    def count(self) -> int:
        """Of paths."""
        return len(self.pixel)

    def of(self, chosen):
        """Some of the paths: a mask (n,), numbers of paths or a slice; copies."""
        # `take` copies whole rows: a third to two thirds of the time of indexing with a mask
        rows = np.arange(self.count)[chosen]
        if not len(rows):
            return type(self)(*(field if field is None else field[:0] for field in self))
        return type(self)(*(field if field is None else field.take(rows, axis=0) for field in self))

    def off_grains(self):
        """Where they are no grain is known to be."""
        self.grains[:], self.triangle[:], self.sphere[:] = -1, -1, UNKNOWN

    def away_from_surfaces(self):
        """They start at no surface of the scene and no grain, and their directions have been drawn where they are."""
        self.off_grains()
        self.far[:] = np.nan
        self.drawn[:] = self.origin


def joined(parts):
    """Paths of several records of a kind, of at least one."""
    filled = [part for part in parts if part.count] or parts[:1]
    return filled[0] if len(filled) == 1 else type(filled[0])(*(
        None if fields[0] is None else np.concatenate(fields) for fields in zip(*filled)))


def of_camera(rays, key, first, pixel, places=None):
    """Random streams (n,), origins (n, 3) m and directions (n, 3) of the camera's paths.

    rays : of offsets (n, 2) in pixels (n, 2), as `Camera.rays_at` or `World.camera_rays`, which takes rows and columns
    key : uint64, of `bakery.kernels.stream_key`;  first : number of the first path
    places : (n, 2) in their pixels, as of `renderers.transport.steps.places`; by chance if None
    """
    states = wavefront.streams(key, len(pixel), first)
    return states, *rays(wavefront.uniforms(states, 2) if places is None else places, pixel)


def follow(total, together, begin, step):
    """Takes `total` paths through all of their steps, at most so many together.

    begin : (first, last) -> paths of these numbers;  step : paths -> those that go on
    """
    started, paths = 0, begin(0, 0)
    with threads.of_drjit() as expect:
        while started < total or paths.count:
            if started < total and paths.count < together // 2:
                last = min(started + together, total)
                expect(last - started)
                started, paths = last, joined([paths, begin(started, last)])
            expect(paths.count)
            if paths.count:
                paths = step(paths)
