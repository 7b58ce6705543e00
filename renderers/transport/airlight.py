"""Light samples along flights through thin media: light scattered once into a line of sight, at a distance drawn for a lamp.

In a thin medium few paths scatter, and light samples at scatterings alone hit upon the glow around a lamp rarely: its variance
has no bound, as light goes with one over the square of the distance.  Here each flight through a thin medium takes one light
sample at a distance of its own, whether or not it ends by a scattering: equiangular from the lamp that is drawn (Kulla and
Fajardo 2012), or as a collision that is forced before its end.  Scatterings in such media take none.  A path that scatters by
chance and meets the light shares with it by the balance heuristic, of the densities of the distance and of the direction.

What no scattering takes goes on to the surface behind as ever, and light scattered more often by further flights.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import numpy as np

from renderers.mitsuba.shading import by_number, single
from renderers.transport import flights, media

import mitsuba as mi  # isort: skip

# share of the distances, of lamps that have a place.  Variance of scattered light: small lamp 1, 0.64, 0.57 at 0.5, 0.75, 0.9;
# point lamp above a floor 1, 0.9, 1.1, in haze alone 1, 0.7, 0.6
_EQUIANGULAR = 0.75
_FORWARD = 0.5  # share of those, evenly in the logarithm of the angle: droplets scatter forward, within a degree or two
_NEARLY_NONE = 0.01  # optical depth below which collisions are forced evenly: there 1 - exp(-x) has few digits
_LEAST = 1e-6  # of the distance to a lamp: how near to it flights pass at least


@dataclass
class Stretch:
    """Of flights, from where to where light samples may lie, of each path as it was before.

    active : whether there is one;  origin, direction, near, far : of the ray, and distances on it
    throughput, inside, order : of the path;  chance : density (1 over a length) of the scattering that ended it
    """

    active: mi.Bool
    origin: mi.Point3f
    direction: mi.Vector3f
    near: mi.Float
    far: mi.Float
    throughput: list
    inside: mi.UInt32
    order: mi.UInt32
    chance: mi.Float


@dataclass
class Before:
    """Of paths, the flight before their last scattering, from whose light samples they share light.

    origin, direction, near, far : as of a `Stretch`; no length: there were none
    """

    origin: mi.Point3f
    direction: mi.Vector3f
    near: mi.Float
    far: mi.Float


class Airlight:
    """Light samples along flights of a scene."""

    def __init__(self, scene, thin, hidden):
        """
        scene : `scene.Scene`
        thin : (media,) bool, those through which flights take light samples
        hidden : bits of the bodies in which they take none: light samples do not come through their boundaries
        """
        self._scene, self._hidden = scene, mi.UInt32(hidden)
        self._thin = mi.UInt32(np.asarray(thin, np.uint32))
        emitters = scene.scene.emitters()
        anchors = self.anchors(emitters)
        self._anchors = single(anchors.ravel())
        self._rows = mi.UInt32(by_number(emitters, range(len(emitters))))
        self._met = any(anchor[3] > 0 for anchor in anchors)  # lamps with an anchor that paths may meet
        # the least of all, so that densities fall off no faster than light
        sigma = np.array([[float(value[0]) for value in scene.media.sigma_t(mi.UInt32(number))]
                          for number in np.flatnonzero(thin)])
        sigma = np.where(sigma > 0, sigma, sigma[sigma > 0].min()).min(axis=0)
        self._sigma = [dr.opaque(mi.Float, float(value)) for value in sigma]

    @staticmethod
    def anchors(emitters):
        """(n, 4) middles of emitters and half of the diagonals of the boxes around them; -1 in place of the latter where there is
        none, as of a sky."""
        return np.array([_anchor(emitter) for emitter in emitters])

    def none(self, width):
        """`Before` of paths that have not scattered; None where none is needed."""
        return dr.zeros(Before, width) if self._met else None

    @staticmethod
    def no_stretch(path):
        """`Stretch` of paths that have not flown."""
        width = dr.width(path.alive)
        empty = dr.zeros(Stretch, width)
        empty.throughput = [dr.zeros(mi.Float, width) for _ in path.throughput]
        return empty

    def takes(self, medium, inside):
        """Whether flights through a medium take light samples, and scatterings in it none; inside : bodies around."""
        return (dr.gather(mi.UInt32, self._thin, medium) != 0) & ((inside & self._hidden) == 0)

    def stretch(self, path, ray, active, ends):
        """`Stretch` of flights; active : those that may take a light sample;  ends : pair of distances, the last one without."""
        return Stretch(mi.Bool(active), mi.Point3f(ray.o), mi.Vector3f(ray.d), *map(mi.Float, ends),
                       [mi.Float(weight) for weight in path.throughput], mi.UInt32(path.inside), mi.UInt32(path.order),
                       dr.zeros(mi.Float, dr.width(path.alive)))

    def scattered(self, path, event):
        """Changes densities of paths that have scattered, to those of what their flights' light samples share with."""
        stretch = event.stretch
        shares = event.scatters & self.takes(event.medium, path.inside)
        evenly = self._forced(stretch, dr.norm(event.position - stretch.origin))
        path.density *= dr.select(shares & (evenly > 0), stretch.chance / evenly, 1)
        if path.before is None:
            return
        drawn_anew = event.scatters | (event.meets & ~event.crosses)
        for name in vars(path.before):
            setattr(path.before, name, dr.select(shares, getattr(stretch, name), getattr(path.before, name)))
        path.before.far = dr.select(drawn_anew & ~shares, path.before.near, path.before.far)

    def rival(self, path, emitter, active):
        """By what to multiply densities of light samples where paths meet emitters."""
        before = path.before
        if before is None:
            return mi.Float(1)
        active = active & (before.far > before.near)
        anchor = self._anchor_of(dr.gather(mi.UInt32, self._rows, dr.reinterpret_array(mi.UInt32, emitter), active), active)
        distance = dr.norm(path.drawn - before.origin)
        forced = self._forced(before, distance)
        return dr.select(active, self._mixed(before, anchor, distance, forced) / forced, 1)

    def sampled(self, path, stretch):
        """Light of one light sample along each flight, linear sRGB, and its emitters; by the throughput before the flight."""
        scene, random, active = self._scene, path.random, mi.Bool(stretch.active)
        u = mi.Point2f(random.next_float32(), random.next_float32())
        which, v = random.next_float32(), random.next_float32()
        anchor = self._anchor_of(scene.scene.sample_emitter(u.x, active)[0], active)
        distance = self._drawn(stretch, anchor, which, v)
        density = self._mixed(stretch, anchor, distance, self._forced(stretch, distance))
        medium, depth = flights.reached(scene, mi.Ray3f(stretch.origin, stretch.direction), stretch.inside, distance, active)
        active &= self.takes(medium, stretch.inside) & (density > 0)
        point = stretch.origin + distance * stretch.direction
        interaction = mi.Interaction3f(0.0, 0.0, dr.zeros(mi.Color0f), point, mi.Normal3f(0))
        light, radiance = scene.scene.sample_emitter_direction(interaction, u, False, active)
        active &= (light.pdf > 0) & dr.any(radiance > 0)
        weights = [w * sigma * dr.exp(-d) for w, sigma, d in zip(stretch.throughput, scene.media.sigma_t(medium), depth)]
        chance = media.total(weights) / media.total(stretch.throughput)
        weights = media.product(weights, scene.media.albedo(medium))
        phase = scene.media.phase(medium, 0.5 * dr.squared_norm(light.d - stretch.direction))
        by_chance, by_sample = chance * media.mean(weights, phase), density * light.pdf
        share = dr.select(light.delta, 1, by_sample / (by_sample + by_chance))
        passed = flights.of_light(scene, interaction, light, stretch.inside, active)
        weights = media.product(media.product(weights, phase), passed)
        return scene.seen(weights, radiance * share / density, active), light.emitter

    def _anchor_of(self, row, active):
        """Of emitters, by their numbers: place and size; size below 0 of what has none."""
        return dr.gather(mi.Vector4f, self._anchors, row, active)

    def _drawn(self, flight, anchor, which, u):
        """Distances for lamps: a number chooses how each is drawn."""
        share = dr.select(anchor.w >= 0, mi.Float(_EQUIANGULAR), 0)
        which_wave = (which - share) / (1 - share)
        around = dr.select(which < (1 - _FORWARD) * share, _equiangular(flight, anchor, u), _forward(flight, anchor, u))
        drawn = dr.select(which < share, around, self._collision(flight, which_wave, u))
        return dr.clip(drawn, flight.near, flight.far)

    def _collision(self, flight, which, u):
        """Distances of forced collisions; a number chooses a wavelength."""
        length = flight.far - flight.near
        sigma = media.chosen(self._sigma, dr.minimum(mi.UInt32(which * len(self._sigma)), len(self._sigma) - 1))
        falling = -dr.log(1 - u * (1 - dr.exp(-sigma * length))) / sigma
        return flight.near + dr.select(sigma * length < _NEARLY_NONE, u * length, falling)

    def _forced(self, flight, distance):
        """Densities of those, 1 over a length."""
        length, density = flight.far - flight.near, mi.Float(0)
        for sigma in self._sigma:
            falling = sigma * dr.exp(-sigma * (distance - flight.near)) / (1 - dr.exp(-sigma * length))
            density += dr.select(sigma * length < _NEARLY_NONE, 1 / length, falling) / len(self._sigma)
        return density

    @staticmethod
    def _mixed(flight, anchor, distance, forced):
        """Densities of distances for lamps, of which those of forced collisions are one part."""
        nearest, width, angle = _angles(flight, anchor)
        first, folds = _scattering_angles(flight, nearest, width, angle)
        by_angle = dr.lerp(1 / angle, 1 / (folds * dr.maximum(dr.atan2(width, nearest - distance), first)), _FORWARD)
        around = by_angle * width / (dr.square(width) + dr.square(distance - nearest))
        return dr.select(anchor.w >= 0, dr.lerp(forced, around, _EQUIANGULAR), forced)


def _scattering_angles(flight, nearest, width, angle):
    """By which light of a lamp is scattered where rays begin, and the natural logarithm of how much more where they end."""
    first = dr.atan2(width, nearest - flight.near)
    ratio = angle / first
    return first, dr.select(ratio < 1e-3, ratio, dr.log(1 + ratio))


def _angles(flight, anchor):
    """Where rays come nearest to a lamp, how near, and the angle under which they are seen from so far beside."""
    towards = mi.Vector3f(anchor.x, anchor.y, anchor.z) - mi.Vector3f(flight.origin)
    nearest = dr.dot(towards, flight.direction)
    aside = dr.squared_norm(towards - nearest * flight.direction)
    # a lamp's size, too: near to a wide one its light does not go with one over the square of the distance to its middle
    width = dr.maximum(dr.sqrt(aside + dr.square(anchor.w)), _LEAST * dr.norm(towards))
    near, far = flight.near - nearest, flight.far - nearest
    # of the difference, which angles near a right one would lose
    return nearest, width, dr.atan2(width * (far - near), dr.fma(near, far, dr.square(width)))


def _equiangular(flight, anchor, u):
    """Distances on rays, evenly in the angle seen from a lamp."""
    nearest, width, angle = _angles(flight, anchor)
    sine, cosine = dr.sincos(u * angle)
    begin = (flight.near - nearest) / width
    return nearest + width * (begin * cosine + sine) / (cosine - begin * sine)


def _forward(flight, anchor, u):
    """Distances on rays, evenly in the logarithm of the angle by which a lamp's light is scattered there."""
    nearest, width, angle = _angles(flight, anchor)
    first, folds = _scattering_angles(flight, nearest, width, angle)
    return nearest - width / dr.tan(first * dr.exp(u * folds))


def _anchor(emitter):
    """Middle and half of the diagonal of the box around an emitter; -1 in place of the latter where it has none."""
    box = emitter.bbox()
    low, high = (np.array(corner, float).ravel() for corner in (box.min, box.max))
    if not np.all(np.isfinite([low, high])) or np.any(high < low):
        return np.array([0.0, 0.0, 0.0, -1.0])
    return np.append((low + high) / 2, np.linalg.norm(high - low) / 2)
