"""What a loop of Dr.Jit asks of a Mitsuba scene with media: camera, colours, and the media on a ray."""

import copy
from types import MappingProxyType

import drjit as dr
import numpy as np

from renderers.mitsuba import shading
from renderers.mitsuba.recording import pointers
from renderers.mitsuba.shading import single
from renderers.transport import regions, thin
from renderers.transport.aureoles import Aureoles
from renderers.transport.boundaries import Boundaries
from renderers.transport.far import FarSurfaces
from renderers.transport.media import Media
from renderers.transport.regions import Grid, Medium, Regions
from renderers.transport.samples import samples
from renderers.transport.scattering import vacuum
from renderers.transport.solids import SMALLER, volume
from renderers.transport.splitting import Splitting, smooth
from renderers.transport.voxels import Voxels

import mitsuba as mi  # isort: skip

MOST = 32  # media: a bit each


class View:
    """Surfaces, lights, camera and colours.

    scene : of Mitsuba;  waves : number of wavelengths
    light_number : of emitters, their places among `lights` lights, -1 for none
    around_camera : what the camera stands in, as a path's `inside`
    airlight : `airlight.Airlight`, along flights through thin media; None where there are none
    aureoles : `aureoles.Aureoles`, of small lamps in these
    lamps : `samples.Samples`, which go through smooth boundaries of bodies; None where there are none
    most : of each medium, scatterings between two surfaces that a path may have; None: any number
    """

    around_camera = 0
    lamps = airlight = aureoles = most = None

    def __init__(self, world, scene, colours):
        """
        world : `renderers.mitsuba.world.World`
        scene : of Mitsuba, the world's, or one of the same lights and more surfaces
        colours : to_rgb (3, L) and to_waves (L, 3)
        """
        self.scene, self.light_number, self.lights = scene, world.light_number, len(world.light_names)
        self._light_positions = world.light_positions  # which `light_number` looks up
        self._reaches = shading.reaches(scene)
        self.waves = len(colours.to_waves)
        self._camera = [mi.Point3f(*row) for row in _camera(world.camera, world.unit).tolist()]
        self._to_rgb, self._to_waves = _entries(colours.to_rgb), _entries(colours.to_waves)
        self._width = mi.UInt32(world.size[1])
        self._corners = None if world.corners is None else [single(column) for column in world.corners.T]
        dr.make_opaque(self._camera, self._width)

    def variables(self) -> list:
        """What a recording of the loop is given: arrays of Dr.Jit's and scenes of Mitsuba's, and kinds of what is in these."""
        return [*_variables(vars(self)), *pointers(self.scene)]

    @property
    def origin(self):
        """Where the camera stands."""
        return self._camera[0]

    def camera_ray(self, pixel, offset):
        """Origin and direction through pixels, numbered by rows, at places in them."""
        origin, corner, right, down = self._camera
        if self._corners is None:
            row = pixel // self._width
            x, y = mi.Float(pixel - row * self._width), mi.Float(row)
        else:
            x, y = (dr.gather(mi.Float, column, pixel) for column in self._corners)
        on_film = corner + (x + offset.x) * right + (y + offset.y) * down
        return origin + dr.zeros(mi.Point3f, dr.width(pixel)), dr.normalize(mi.Vector3f(on_film))

    def from_surface(self, surface, direction):
        """Where paths go on from surfaces."""
        return shading.beside(surface, direction, self._reaches)

    def seen(self, throughput, radiance, active):
        """What throughput of each wavelength makes of radiance, both as linear sRGB."""
        waves = [weight * wave for weight, wave in zip(throughput, _times(self._to_waves, radiance))]
        return [dr.select(active & dr.isfinite(value), value, 0) for value in _times(self._to_rgb, waves)]

    def reflectance(self, colour):
        """Of each wavelength, of what is linear sRGB."""
        return _times(self._to_waves, colour)


class Scene(View):
    """A view with media; those inside of others come before them.

    media : `Media`, one an entry;  entries : numbers of those in the order of the media
    boundaries : `Boundaries` of bodies;  regions, voxels : of the other media
    samples, hides : whether light samples reach scatterings in any medium, and whether not in all (`takes_samples`)
    extent : middle and size of a ball around all surfaces and more
    far : `far.FarSurfaces`, of bodies that are surfaces far from the camera; None where there are none
    splitting : `splitting.Splitting`, of smooth boundaries that the camera sees; None where there are none
    """

    def __init__(self, world, entries, colours, drawn=True, far=MappingProxyType({}), most=None):
        """
        world, colours : as those of a `View`
        drawn : whether light samples of lamps go through smooth boundaries, and paths are split there; else they are as frequent
            as light is
        far : `far.Far` of bodies that are surfaces far from the camera, by their numbers among the entries
        entries : none, or at most `MOST` of the same wavelengths: `regions.Medium`, or bodies, shapes of the Mitsuba scene, with
            name, vertices, faces, medium, matched as a `renderers.materials.bodies.bodies.Body` has them
        most : of each entry, all of them bodies, scatterings between two surfaces that a path may have, after which it goes
            straight to the next with what the medium leaves of it; None: any number
        """
        super().__init__(world, world.scene, colours)
        self.entries = sorted(range(len(entries)), key=lambda number: _place(entries[number]))
        numbered = dict(enumerate(entries[number] for number in self.entries))
        unbounded = {number: entry for number, entry in numbered.items() if isinstance(entry, Medium)}
        bodies = {number: entry for number, entry in numbered.items() if number not in unbounded}
        unit = world.unit
        media = [entry.scatterer if number in unbounded else entry.medium for number, entry in numbered.items()]
        self.media = Media(media or [vacuum(self.waves)], unit)
        self.boundaries = Boundaries(world, bodies)
        self.around_camera = self.boundaries.around_camera
        self.regions = Regions([(1 << number, entry.region) for number, entry in unbounded.items()], unit)
        self.voxels = Voxels({number: entry.region for number, entry in unbounded.items() if isinstance(entry.region, Grid)},
                             len(numbered), unit)
        self.most = None if most is None else mi.UInt32([most[number] for number in self.entries])
        self.far = FarSurfaces(self.boundaries, [far.get(number) for number in self.entries], self.origin, unit) if far else None
        self._is_body = mi.UInt32([int(number in bodies) for number in numbered])
        sampled = [number in unbounded or entry.matched for number, entry in numbered.items()]
        self._sampled, self.samples, self.hides = mi.UInt32([int(each) for each in sampled]), any(sampled), not all(sampled)
        low, high = np.nan_to_num([self.scene.bbox().min, self.scene.bbox().max], posinf=0, neginf=0).reshape(2, 3)
        self.extent = mi.Point3f(*((low + high) / 2).tolist()), mi.Float(float(np.linalg.norm(high - low)))
        dr.make_opaque(self.extent)
        self.splitting = Splitting(self.scene) if drawn and smooth(self.scene) else None
        self.lamps = samples(self, world, bodies) if drawn else None
        self.airlight = thin.airlight(self, numbered, world) if drawn else None
        self.aureoles = None
        if self.airlight and not self.far:
            self.aureoles = Aureoles(*thin.small_lamps(self, world), world.small_share)

    @classmethod
    def of_bodies(cls, world, bodies, colours, most=None) -> "Scene":
        """The scene of bodies alone, in a world whose surfaces stay as they are; parameters as above.

        Pilots and the picture share what it takes a second or two to measure for light samples: it does not depend on the film.
        """
        content = ((body.name, body.matched, _bytes(body.medium)) for body in bodies)
        key = "scene", None if most is None else tuple(most), _bytes(colours), *content
        shared = copy.copy(world.once(key, lambda: cls(world, bodies, colours, most=most)))
        View.__init__(shared, world, world.scene, colours)
        return shared

    def bsdf(self, event):
        """Of the surface that paths have come to, `state.Event`."""
        return self.far.bsdf(event) if self.far else event.surface.bsdf()

    def innermost(self, inside):
        """Whether paths are in a medium, and its number."""
        within = inside != 0
        return within, dr.select(within, dr.tzcnt(inside), 0)

    def takes_samples(self, medium):
        """Whether light samples reach scatterings in a medium: its boundary lets them through."""
        return dr.gather(mi.UInt32, self._sampled, medium) != 0

    def goes_straight(self, path, medium):
        """Whether paths in a medium have no more scatterings up to the next surface."""
        return mi.Bool(False) if self.most is None else path.since >= dr.gather(mi.UInt32, self.most, medium)

    def holds(self, medium, point):
        """Whether points may be in a medium; rounding can lose a path through an edge of a body."""
        return (dr.gather(mi.UInt32, self._is_body, medium) == 0) | self.boundaries.near(point)


def _bytes(arrays):
    return tuple((np.asarray(array).tobytes(), np.shape(array)) for array in arrays)


def _variables(value):
    if dr.is_array_v(value) or isinstance(value, mi.Scene):
        yield value
    elif isinstance(value, dict | list | tuple):
        for part in value.values() if isinstance(value, dict) else value:
            yield from _variables(part)
    elif type(value).__module__.startswith("renderers."):
        yield from _variables(vars(value))


def _place(entry):
    """Of an entry among the others: what is in another has the lesser volume, and of equal ones the body is in the other."""
    if isinstance(entry, Medium):
        return regions.volume(entry.region)
    return (1 - SMALLER) * volume(entry.vertices, entry.faces)


def _camera(camera, unit):
    return np.array([np.asarray(camera.origin) / unit, camera.corner, camera.right, camera.down], float)


def _entries(matrix):
    """Rows of (column, entry) of a matrix, without those that are 0; entries that are 1 as such."""
    return [[(k, None if entry == 1 else dr.opaque(mi.Float, float(entry))) for k, entry in enumerate(row) if entry != 0]
            for row in np.asarray(matrix)]


def _times(entries, values):
    """Product of a matrix with a vector, as lists."""
    products = []
    for row in entries:
        terms = [values[k] if entry is None else values[k] * entry for k, entry in row]
        products.append(sum(terms[1:], terms[0]) if terms else mi.Float(0))
    return products
