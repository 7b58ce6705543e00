"""Transport by teleports (Meng et al. 2015, section 4.1): paths among grains that are traced one by one and have no arrangement.

Between spheres light flies as far as chords of the tile's void are long; in a sphere it meets a grain, turned by chance, at an
offset by chance, and leaves where the grain sends it.  Each sphere is forgotten once it is left.
"""

import numpy as np

from bakery.kernels import stream_key
from renderers.materials.grains import _paths, _teleport
from renderers.materials.grains._entries import Boundary
from renderers.materials.grains._grains import NOWHERE
from renderers.materials.grains._paths import GRAINS, Event, Walk
from renderers.materials.grains.medium import Continuous
from renderers.materials.grains.paths import Explicit, starting, streams_of
from renderers.threads import run
from renderers.transport import wavefront

_CHORDS, _EACH = 1 << 20, 16  # chords that are measured; how many neighbours of them, sorted, are kept as their mean
_LIMIT = 1000.0  # longest chord, in mean ones


class Teleports(Explicit):
    """Paths among spheres that are drawn along each ray.

    grains, occupied, colours : as in `paths.Explicit`
    exponential : whether flights between spheres are exponential, with the same mean (Eq. 1), instead of as the tile has them
    """

    def __init__(self, grains, occupied, colours, *, exponential=False):
        super().__init__(grains, occupied, colours)
        self.boundary, self.flights = Boundary.around(grains), flights(grains.aggregate, exponential=exponential)

    def advance(self, paths):
        """As `paths.Explicit.advance`; no path waits or switches."""
        event = Event.empty(paths.count)
        run(_teleport.advance, paths.count, self.grains, self.flights, self.occupied, paths.part(Walk), paths.centre, event)
        return event

    def next_event(self, paths, event, sample, added):
        """As `paths.Explicit.next_event`; whether light gets there is drawn."""
        bright = (sample.radiance > 0).any(axis=1)
        walk = paths.part(Walk)._replace(direction=np.ascontiguousarray(sample.direction, float))
        clear = self._is_clear(walk, paths.centre, np.where(bright, sample.distance, 0.0))
        # nothing is in the way any more: a distance of 0
        sample = sample._replace(distance=np.zeros_like(sample.distance), radiance=sample.radiance * clear[:, None])
        walk = paths.part(Walk)._replace(sphere=np.full((paths.count, 4), NOWHERE), triangle=np.full(paths.count, -1))
        run(_paths.next_event, paths.count, self.grains, self.colours, walk, event, sample, added)

    def transmittance(self, point, direction, distance, share):
        """Share (n, L), 0 or 1, of light that gets from points along directions to a distance; the same for the same way."""
        n, states = len(point), streams_of(point, direction, distance)
        point, direction = (np.ascontiguousarray(values, float) for values in (point, direction))
        paths = starting(point, direction, share.shape[1], states, np.arange(n), GRAINS)
        share[:] = self._is_clear(paths.part(Walk), paths.centre, distance)[:, None]

    # spheres may be anywhere in the mesh
    entry, seen = Continuous.entry, Continuous.seen

    def _is_clear(self, walk, centre, distance):
        """Whether no grain is on the way of paths to a distance (n,) m; draws from their streams."""
        first = np.array(distance, float)
        run(_teleport.first_grain, len(first), self.grains, self.flights, walk, centre, first)
        return first == np.inf


def flights(aggregate, *, exponential=False) -> _teleport.Flights:
    """Flights between the spheres of an aggregate's tile, widened as it is.

    A million chords of isotropic uniform lines, half a second of a core, scaled to their exact mean 4 V/S; <z^2> of the 65,536
    that are kept is good to 0.3 %.
    """
    radii = aggregate.radii
    fraction = float(4 / 3 * np.pi * np.sum(radii**3) / np.prod(aggregate.cell))
    mean = float(4 / 3 * np.sum(radii**3) / np.sum(radii**2) * (1 - fraction) / fraction)
    area, volume = np.cumsum(radii**2) / np.sum(radii**2), np.cumsum(radii**3) / np.sum(radii**3)
    if exponential:
        chord = -np.log1p(-(np.arange(_CHORDS) + 0.5) / _CHORDS)
    else:
        states, chord = wavefront.streams(stream_key(0, "render.chords"), _CHORDS), np.empty(_CHORDS)
        run(_teleport.chords, _CHORDS, aggregate, area, _LIMIT * mean, states, chord)
        chord.sort()
    void = chord.reshape(-1, _EACH).mean(axis=1)
    void *= mean / void.mean()
    return _teleport.Flights(void, np.cumsum(void) / void.sum(), area, volume, fraction)
