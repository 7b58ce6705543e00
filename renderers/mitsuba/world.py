"""Surfaces, lights and camera of a Mitsuba scene for renderers that trace wavefronts of rays themselves.

Arrays in, arrays out: n rays a call, positions and distances in m, radiance as RGB in the units of the scene file.  Each method
is one launch of Dr.Jit's, with 1 to 3 ms of its own: wavefronts of 10^5 rays and more cost half a us a ray and core to shade.
Samples of lights and of directions are joined by the balance heuristic (Veach and Guibas, SIGGRAPH 1995), so a walk reads

    shading = world.shade(origin, direction, random, density, delta)
    radiance += weight * (shading.emitted + shading.light.radiance * (what the medium leaves of it))
    weight *= shading.weight;  origin, direction = shading.origin, shading.direction;  density, delta = shading.density, ...

and at a scattering event in a medium, with the phase function's value `phase` towards the light of `world.lights(point, random)`,

    radiance += weight * light.radiance * phase * light.share(phase)
"""

import math
from contextlib import contextmanager
from functools import cached_property
from os import PathLike
from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from bakery.errors import UsageError
from renderers.camera import Camera, length
from renderers.mitsuba import beside, lights, shading, shapes, variants
from renderers.mitsuba.recording import pointers, undisturbed
from renderers.mitsuba.scene import load
from renderers.mitsuba.sensor import camera_of
from renderers.mitsuba.shading import FAR, LOBE, LightSample, Shading

_SMALL = math.pi * math.radians(2.0) ** 2  # sr, of lamps that rays meet seldom
SIZE = (480, 640)  # (height, width) of pictures of scenes without a Mitsuba file


class IdealLight(NamedTuple):
    """A light without extent.

    number : position in `World.light_names`
    place : (3,) m, of the light, or, of a distant one, unit, the direction towards it
    distant : whether it is at infinity
    """

    number: int
    place: np.ndarray
    distant: bool


class World:
    """Surfaces, lights and camera.

    camera : `renderers.camera.Camera` in m, or None
    size : (height, width) of the picture, pixels, or None
    scene, unit : of Mitsuba, and the length of 1 in it, m
    light_names : names of the emitters, all different: their id, that of their shape, or their kind
    light_positions : of emitters in `light_names`, by Dr.Jit's numbers for them
    box : (2, 3) m, corners of the box around all surfaces; None where there are none
    without_extent : whether there are lights that no ray can meet, such as points
    lens : whether the sensor has one; it is seen through the middle of it, with all in focus
    variant, reason : of Mitsuba, and why
    coarser, whole : of a pilot (`renderers.choice.trial.smaller`): side of a pixel over that of the picture's, and its world; 1
        and None
    corners : (H W, 2) x and y of the pixels' upper left corners, in pixels of the camera's film; None: rows of pixels, all of it
    clip : m ahead of the camera, the sensor's clipping planes, which are not kept

    Shadow rays end at any surface, also at one without a boundary (`null`) or of glass, as in Mitsuba's `path`: lights without
    extent do not shine through those, but where callers look what is in between (`hidden`).
    """

    coarser, whole, corners, lens, clip = 1.0, None, None, False, (0.0, math.inf)

    def __init__(self, path=None, unit=1.0, *, view=None, size=None, variant=None, parameters=None, sensor=None, filled=None):
        """
        path : Mitsuba XML, or the scene (`mitsuba.Scene`) that was loaded of one; None is a world without surfaces and lights
        unit : m, length of 1 in the scene
        view : `camera` of a scene's YAML (origin, target, up, fov; m, rad), which takes the place of the file's sensor
        size : (height, width), pixels, which takes the place of the file's; the picture's width and its pixels' shape stay
        variant, parameters : as in `renderers.mitsuba.scene.load`; of a path
        sensor : of Mitsuba, in place of the scene's first one
        filled : names of shapes that materials fill; others without a boundary (`null`) are taken out; None: all are kept

        Raises UsageError: the scene cannot be loaded, a light is of no size, below 0 or no number, its sensor is no perspective
        camera, or no variant of Mitsuba runs that works on arrays of colours.
        """
        if path is None:
            self.variant, self.reason = variants.activate("rgb", variant)
            self.scene = mi.load_dict({"type": "scene"})
        elif isinstance(path, (str, PathLike)):
            self.scene, self.variant, self.reason = load(path, variant=variant, parameters=parameters, sensor=view is None)
        else:
            self.scene, self.variant, self.reason, path = path, mi.variant(), "the one that is set", "the scene"
            lights.refuse(path, self.scene)
        if not self.variant.endswith("_ad_rgb"):
            raise UsageError(f"variant {self.variant}: surfaces and lights need one that works on arrays of colours, such as "
                             f"llvm_ad_rgb ({self.reason})")
        self._media = [shape.id() for shape in self.scene.shapes() if shape.interior_medium() or shape.exterior_medium()]
        if filled is not None:
            self.scene = shapes.without_nothing(self.scene, filled)
        self.unit, self._measured = float(unit), {}
        self.camera, self.size = self._view(path, sensor, view, size)
        self._name_lights()
        box = self.scene.bbox()
        self.box = np.array([box.min, box.max], float).reshape(2, 3) * self.unit if box.valid() else None

    @classmethod
    def of(cls, scene, variant=None) -> "World":
        """Of a `renderers.scene.Scene`, with the size of its film; errors as above."""
        film, surfaces = scene.values.film, scene.values.scene
        size = (film.height, film.width) if film.height else None
        if surfaces is None:
            return cls(view=scene.values.camera, size=size or SIZE, variant=variant)
        filled = {getattr(getattr(entry, "where", None), "shape", None) for entry in scene.materials}
        return cls(scene.file(surfaces.mitsuba), surfaces.unit, view=scene.values.camera, size=size, variant=variant,
                   parameters=surfaces.parameters, filled=filled)

    @contextmanager
    def as_it_is(self):
        """What BSDFs its shapes are given meanwhile, they have no more afterwards."""
        shapes = list(self.scene.shapes())
        earlier = [shape.bsdf() for shape in shapes]
        try:
            yield
        finally:
            for shape, bsdf in zip(shapes, earlier, strict=True):
                if bsdf is not None and shape.bsdf() is not bsdf:
                    shape.set_bsdf(bsdf)

    def once(self, key, measure):
        """What `measure()` gives; of the same key also for copies of this world, such as those of pilots: what has nothing to do
        with the film."""
        if key not in self._measured:
            self._measured[key] = measure()
        return self._measured[key]

    def forget(self):
        """Lets go what `once` keeps: no more copies of this world will ask for it, pilots of other methods least of all."""
        self._measured.clear()

    def shapes(self) -> list[shapes.Shape]:
        """All surfaces of the scene."""
        return shapes.of_scene(self.scene, self.unit)

    def media(self) -> list[str]:
        """Sentences on media of the Mitsuba file, none of which is kept."""
        return [f"media of the Mitsuba file, at {_examples(self._media)}, are left out: materials say what is in the scene"] \
            if self._media else []

    def left_out(self, besides=frozenset()) -> list[str]:
        """Sentences on light that no sample finds (areas that shine in one direction), and on that of lamps without extent by
        way of mirrors, smooth glass and what light goes straight through, but for shapes of some names: no ray meets such lamps,
        and light samples end there.  Also on shadows that are lost to single precision."""
        if not self.without_extent:
            return beside.left_out(self)
        unmet = [name for name, emitter in zip(self.light_names, self.scene.emitters())
                 if mi.has_flag(emitter.flags(), mi.EmitterFlags.Delta)
                 and (emitter.get_shape() is not None or not emitter.sampling_weight() > 0)]
        standing = [shape for shape in (*self.shapes(), *shapes.grouped(self.scene, self.unit)) if shape.name not in besides]
        kinds = {"mirrors, smooth coats and smooth glass": [shape.name for shape in standing if shape.specular],
                 "masks and boundaries that are null": [shape.name for shape in standing if shape.passed and not shape.specular]}
        never = ["light of areas that shine in one direction, or of lamps without extent whose sampling_weight is 0 "
                 f"({_examples(unmet)}) is left out, and how much is not measured: neither rays nor light samples meet it, as in "
                 "Mitsuba's path; a directional light or a spot, of some weight, is found"]
        return beside.left_out(self) + never * bool(unmet) + [
            f"light of lamps without extent by way of {kind} ({_examples(names)}) is left out, and how much is not measured; "
            "a small sphere that shines in its place is found" for kind, names in kinds.items() if names]

    def extents(self, within=None):
        """Where surfaces are, m: triangles (T, 3, 3) of the meshes, and boxes (B, 2, 3) around the other shapes.

        within : (2, 3) m, corners of a box: of spheres around it there is nothing in it, and they are left out; None: of none
        """
        triangles, boxes = [np.zeros((0, 3, 3))], [np.zeros((0, 2, 3))]
        for shape in self.shapes():
            if shape.faces is None:
                if within is None or not (shape.sphere and shapes.encloses(shape.box, within)):
                    boxes.append(shape.box[None])
            else:
                triangles.append(shape.vertices[shape.faces])
        return np.concatenate(triangles), np.concatenate(boxes)

    def _view(self, path, sensor, view, size):
        if sensor is None:
            sensor = next(iter(self.scene.sensors()), None)
        of_sensor = None if sensor is None else tuple(int(side) for side in np.array(sensor.film().crop_size()).ravel()[::-1])
        size = size or of_sensor
        if view is not None and size is not None:
            return Camera.looking(**dict(view), height=size[0], width=size[1]), size
        if of_sensor is None:
            return None, size
        self.lens = bool(sensor.needs_aperture_sample())
        camera = camera_of(sensor, path, of_sensor[1], of_sensor[0])
        self.clip = self.unit * sensor.near_clip(), self.unit * sensor.far_clip()
        camera = Camera(camera.origin * self.unit, camera.corner, camera.right, camera.down)
        return camera.refitted(*of_sensor, *size), size

    def _name_lights(self):
        """Names of emitters, and their positions by Dr.Jit's numbers for them."""
        emitters = self.scene.emitters()
        self.light_names = lights.names_of(emitters)
        infinite = [mi.has_flag(emitter.flags(), mi.EmitterFlags.Infinite) for emitter in emitters]
        self.light_positions = mi.Int32(shading.by_number(emitters, range(len(emitters)), np.int32, -1))
        self.without_extent = any(mi.has_flag(emitter.flags(), flag) for emitter in emitters
                                  for flag in (mi.EmitterFlags.DeltaPosition, mi.EmitterFlags.DeltaDirection))
        self._infinite = np.array([*infinite, False])  # -1, no light, is the last one

    def camera_rays(self, random, pixel):
        """Rays through `pixel` (n, 2), row and column, at `random` (n, 2) places in it: origin (n, 3) m and direction (n, 3)."""
        return self.camera.rays_at(np.asarray(random, float)[:, ::-1], np.asarray(pixel)[:, ::-1])

    def trace(self, origin, direction, longest):
        """Distances to the first surface, (n,) m; inf where there is none within `longest` (n,) or (), m."""
        if not len(origin):
            return np.zeros(0)
        longest = np.minimum(np.broadcast_to(longest, len(origin)), FAR)
        ray = self._ray(origin, direction)
        ray.maxt = shading.rows(longest / self.unit)
        hit = self.scene.ray_intersect_preliminary(ray, coherent=False)
        distance, valid = shading.arrays(len(origin), hit.t, hit.is_valid())
        return np.where(valid, self._metres(distance), np.inf)

    def depth(self, entry=None):
        """How far ahead of the camera, along its axis, the middle of each pixel meets something, (H, W) m; inf: nothing.

        Glass counts as a surface, as do boundaries of bodies that refract nothing: what is seen through them lies behind.

        entry : function of origins (n, 3), directions (n, 3) and distances (n,) m to surfaces -> distances (n,) m, to what else
            is there before them, inf where nothing is
        """
        direction = self.camera.rays(*self.size).reshape(-1, 3)
        origin = np.full(direction.shape, self.camera.origin)
        distance = self.trace(origin, direction, FAR)
        if entry is not None:
            distance = np.minimum(distance, entry(origin, direction, distance))
        return distance.reshape(self.size) / length(self.camera.points(*self.size))

    def first_surface(self, origin, direction):
        """Distances to the first surface, (n,) m, inf where there is none, and cosines (n,), positive, to its normal."""
        if not len(origin):
            return np.zeros(0), np.zeros(0)
        ray = self._ray(origin, direction)
        si = self.scene.ray_intersect(ray, ray_flags=mi.RayFlags.Minimal, coherent=False)
        distance, valid, cosine = shading.arrays(len(origin), si.t, si.is_valid(), dr.abs(dr.dot(si.n, ray.d)))
        return np.where(valid, self._metres(distance), np.inf), cosine

    def first_shape(self, origin, direction, name):
        """Distances to the first surface, (n,) m, inf where there is none, and whether that is the shape of a name, (n,)."""
        hit = self.scene.ray_intersect_preliminary(self._ray(origin, direction), coherent=False)
        (shape,) = (shape for shape in self.scene.shapes() if shape.id() == name)
        distance, valid, its = shading.arrays(len(origin), hit.t, hit.is_valid(), hit.shape == mi.ShapePtr(shape))
        return np.where(valid, self._metres(distance), np.inf), valid & its

    def lights(self, point, random, *, hidden=True) -> LightSample:
        """A light from each of n points in the medium, (n, 3) m; `random` (n, 2) or more columns, of which two are used.

        hidden : surfaces hide lights; else the caller looks what is in between
        """
        if not len(point):
            return self._no_light
        interaction = dr.zeros(mi.Interaction3f, len(point))
        interaction.p = self._inside(point)
        u = mi.Point2f(*shading.uniform(random, 0, 2))
        sample, radiance = self.scene.sample_emitter_direction(interaction, u, hidden)
        return self._light(*shading.arrays(len(point), sample.d, sample.dist, shading.finite(radiance), sample.pdf, sample.delta,
                                    self.light_number(sample.emitter)))

    @cached_property
    def _no_light(self):
        return shading.empty(self.lights(np.zeros((1, 3)), np.zeros((1, 2))))

    @cached_property
    def small_share(self) -> float:
        """Share of the light, 0 to 1, that comes from lamps of some degrees and less, by how dense light samples are there: right
        within some per cent, at the middle of the surfaces that do not shine, or at the camera; 0 in the dark."""
        light, sample = self._looked
        return float(np.sum(light * sample.share(1 / _SMALL)) / max(light.sum(), 1e-300))

    @cached_property
    def noise_by_chance(self) -> float:
        """Root mean square over the mean of the light, at the same point, that directions bring which are even over the sphere:
        1 under an even sky, 2/r times their share of all light for lamps of a half angle r, inf without extent, 0 in the dark."""
        light, sample = self._looked
        square = np.where(light > 0, light**2 * np.where(sample.delta, np.inf, sample.density), 0.0)
        return math.sqrt(4 * math.pi * float(np.mean(square))) / max(float(np.mean(light)), 1e-300)

    @cached_property
    def _looked(self):
        """Light (n,) of light samples at the point where lamps are told from each other, and the samples."""
        boxes = [shape.bbox() for shape in self.scene.shapes() if not shape.is_emitter()]
        corners = np.array([[box.min, box.max] for box in boxes], float).reshape(-1, 2, 3)
        middle = np.zeros(3) if self.camera is None else self.camera.origin
        if boxes:
            middle = self.unit * (corners[:, 0].min(axis=0) + corners[:, 1].max(axis=0)) / 2
        sample = self.lights(np.tile(middle, (len(lights.LATTICE), 1)), lights.LATTICE, hidden=False)
        return sample.radiance.sum(axis=1).astype(float), sample

    @property
    def sky(self) -> bool:
        """Whether a light is at infinity."""
        return bool(self._infinite.any())

    @cached_property
    def extended(self) -> bool:
        """Whether a light has an extent, so that directions may meet it by chance."""
        return any(not mi.has_flag(emitter.flags(), mi.EmitterFlags.Delta) for emitter in self.scene.emitters())

    @property
    def dark(self) -> bool:
        """Whether no light shines: there is none, or each is 0 everywhere."""
        return lights.dark(self.scene)

    def lights_in(self, boxes) -> list[int]:
        """Positions in `light_names` of lights that stand in one of some boxes (2, 3) m, or reach into it.

        A sphere around a box does not: light of a sky that is one would be sampled from inside of glass.
        """
        positions = []
        for position, emitter in enumerate(self.scene.emitters()):
            if self._infinite[position]:
                continue
            shape = emitter.get_shape() or emitter
            its, sphere = shape.bbox(), shapes.is_sphere(shape)
            its = self.unit * np.array([its.min, its.max], float).reshape(2, 3)
            near = (box for box in boxes if np.all((its[0] <= box[1]) & (its[1] >= box[0])))
            if not all(sphere and shapes.encloses(its, box) for box in near):
                positions.append(position)
        return positions

    def light_angles(self, point):
        """Angle (lights,) rad that each light is seen as from a place (3,) m: across its box; pi of an even sky, 0 of lights
        without extent and of skies that are pictures."""
        angles = np.zeros(len(self.light_names))
        for position, emitter in enumerate(self.scene.emitters()):
            shape = emitter.get_shape()
            if shape is not None:
                its = self.unit * np.array([shape.bbox().min, shape.bbox().max], float).reshape(2, 3)
                across = np.sort(its[1] - its[0])[1]  # a rectangle's box has no thickness
                angles[position] = 2 * np.arctan2(across / 2, np.linalg.norm(its.mean(axis=0) - point))
            elif emitter.class_name() == "ConstantBackgroundEmitter":
                angles[position] = np.pi
        return angles

    def light_rays(self, light, random):
        """Rays on which a light (position in `light_names`) sends its power: origins (n, 3) m on it, unit directions (n, 3), and
        powers (n, 3) RGB, radiance times m^2 sr, over the density of the ray.

        random : (n, 5) or more columns, of which five are used
        """
        wave, *places = shading.uniform(random, 0, 5)
        ray, power = self.scene.emitters()[light].sample_ray(0.0, wave, mi.Point2f(*places[:2]), mi.Point2f(*places[2:]))
        origin, direction, power = shading.arrays(len(random), ray.o, ray.d, shading.finite(power))
        return self._metres(origin), direction.astype(float), power * self.unit**2

    def ideal_lights(self) -> list[IdealLight]:
        """Lights without extent of which a light sample tells where they are."""
        ideal, middle = [], self.box.mean(axis=0, keepdims=True) if self.box is not None else np.zeros((1, 3))
        for number, emitter in enumerate(self.scene.emitters()):
            flags = emitter.flags()
            distant = mi.has_flag(flags, mi.EmitterFlags.Infinite)
            # beams with an area have a direction, but no sample finds them
            beam = distant and mi.has_flag(flags, mi.EmitterFlags.DeltaDirection)
            if beam or mi.has_flag(flags, mi.EmitterFlags.DeltaPosition):
                sample = self.from_light(number, middle)
                towards = sample.direction[0].astype(float)
                towards /= np.linalg.norm(towards)  # what rounding to single precision leaves kept Newton's method from its end
                shift = sample.distance[0] * towards if sample.distance[0] > 0 else 0.0  # there, it has no direction
                ideal.append(IdealLight(number, towards if distant else middle[0] + shift, distant))
        return ideal

    def from_light(self, number, point) -> LightSample:
        """A light without extent from each of n points (n, 3) m, whatever is in between."""
        if not len(point):
            return shading.empty(self.from_light(number, np.zeros((1, 3))))
        interaction = dr.zeros(mi.Interaction3f, len(point))
        interaction.p = self._inside(point)
        sample, radiance = self.scene.emitters()[number].sample_direction(interaction, mi.Point2f(0.5))
        return self._light(*shading.arrays(len(point), sample.d, sample.dist, shading.finite(radiance), sample.pdf, sample.delta,
                                    mi.Int32(number)))

    def shade(self, origin, direction, random, density, delta, drawn=None, *, power=False, hidden=True) -> Shading:
        """What rays meet: emission, a light sample and a next direction.

        origin, direction : (n, 3) m, (n, 3) unit
        drawn : (n, 3) m, where the direction was drawn; at the origin if None
        power : the rays carry power from lights, not radiance to the eye, which differ where light is refracted
        hidden : as in `lights`
        random : (n, 5) or more columns, of which five are used
        density : (n,) 1/sr, of the direction
        delta : (n,) bool, the direction has no density, as camera rays and reflections have none: emission counts in full
        """
        if not len(origin):
            one_ray = np.zeros((1, 3)), np.eye(1, 3), np.zeros((1, 5)), np.ones(1), np.ones(1)
            return shading.empty(self.shade(*one_ray, power=power, hidden=hidden))
        # the origins twice, where they are: a kernel that reads them once is another
        places, drawn = self._inside(origin), self._inside(origin if drawn is None else drawn)
        u, by_ray = shading.uniform(random, 0, LOBE + 3), [shading.rows(values) for values in (density, delta)]
        directions = mi.Vector3f(*shading.columns(direction))
        with undisturbed():
            met = self._meets((power, hidden), self.scene, pointers(self.scene), (self.light_positions, self.reaches), places,
                              directions, drawn, u, *by_ray)
        hit, point, emitted, source, by_light, *sample, start, chosen, weight, by_next, smooth = shading.arrays(len(origin), *met)
        return Shading(hit, self._metres(point), emitted, source, by_light, self._light(*sample), self._metres(start), chosen,
                       weight, by_next, ~smooth)

    @cached_property
    def reaches(self):
        """As `shading.beside` takes it."""
        return shading.reaches(self.scene)

    @cached_property
    def _meets(self):
        """`shading.met` without what is the same for all rays: Dr.Jit's work to trace and assemble what all kinds of surfaces and
        lights do was 12 of the 15 ms of a call with few rays."""
        if not (self.scene.shapes() and self.scene.emitters()):
            return shading.met  # a recording sees the surfaces and lights of all scenes that there are only if this one has some
        if any(emitter.get_shape() is not None and mi.has_flag(emitter.flags(), mi.EmitterFlags.SpatiallyVarying)
               for emitter in self.scene.emitters()):
            return shading.met  # a sample of a lamp with a texture asks its shape, and a recording takes no nested calls
        # as many rays as an array of the scene is long are recorded anew
        return dr.freeze(shading.met, limit=64, warn_after=1 << 30)

    def _light(self, direction, distance, radiance, density, delta, light):
        distance = np.where(self._infinite[light], FAR, self._metres(distance))
        return LightSample(direction, distance, radiance, density, delta, light)

    def light_number(self, emitter):
        """Positions of emitters in `light_names`; Dr.Jit's 0 is none."""
        return shading.light_number(self.light_positions, emitter)

    def _metres(self, inside):
        return inside.astype(float) * self.unit

    def _inside(self, point):
        return mi.Point3f(*shading.columns(np.asarray(point) / self.unit))

    def _ray(self, origin, direction):
        return mi.Ray3f(self._inside(origin), mi.Vector3f(*shading.columns(direction)))


def _examples(names):
    """The first of many names."""
    return ", ".join(names[:3]) + (", …" if len(names) > 3 else "")
