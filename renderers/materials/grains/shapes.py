"""Explicit path tracing among grains that are shapes of a Mitsuba scene: a loop of Dr.Jit, one kernel a pass.

One ray finds the next surface, whatever it is.  Balls of a type are one shape, `ellipsoids`, which stops rays from outside alone:
where a ray leaves a ball follows from the ball that it is in.  Stones of a type are one mesh, whose triangles take memory.
Surfaces of grains are Mitsuba's white ones; what they leave of each wavelength is a factor beside them.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import drjit as dr
import numpy as np

from bakery.kernels import CONDUCTOR, DIELECTRIC, DIFFUSE
from renderers.materials.grains.listed import exemplar_mesh, listed
from renderers.materials.grains.paths import Explicit
from renderers.mitsuba.shapes import mesh
from renderers.transport import loop, passes, regularised, state
from renderers.transport.scene import View

import mitsuba as mi  # isort: skip

# bounces after which some paths end: in heaps of clear grains many are as long as some hundred grains, and what ends them earlier
# makes the others bright
_FAR = 1024
# Of all bodies: balls, listed in a second; clear ones, among whom short paths wait for long ones, so that beyond many
# the compiled loops are quicker; triangles, some 300 bytes each
_BALLS, _CLEAR, _TRIANGLES = 1 << 18, 2048, 1 << 20
_SEARCHED = 1 << 20  # grains in the box around a body, up to which they are counted
# of coordinates in single precision, by which rays begin beside grains; share of the least radius that it may be at most
_OFF, _OFF_RADIUS = 2e-6, 0.01
# Mitsuba's `ellipsoids` lacks digits where balls are far away, and small in units of the scene.  Of those of this radius or more,
# this many of it away from the camera and each other, 2 rays in 10,000 miss; of those of 0.1 units 1,000 radii away a third do
_LEAST, _NEAR = 0.3, 1000
_SAMPLES, _PATHS = 64, 1 << 19  # a pixel and pass, at most, where a pixel has several; of a pass: a second or two


@dataclass
class Path(state.Path):
    """As `state.Path`, with `inside` the number, from 1, of the grain around;  grain : of that which each is on;  0: none."""

    grain: mi.UInt32 = None


class Packed(NamedTuple):
    """Grains of a type that are one shape.

    shape : of Mitsuba;  kind : the type;  parts : primitives of a grain
    centre, radius : (N, 3), (N,) of balls; radius 0 of stones
    """

    shape: object
    kind: int
    parts: int
    centre: np.ndarray
    radius: np.ndarray


@dataclass
class Meeting:
    """Of paths with surfaces.

    meets, misses, surface : as in `state.Event`
    number, kind : of the grain, and its type, from 1; 0 of what is none
    sample, factor : next direction by the BSDF, and its weight
    """

    meets: mi.Bool
    misses: mi.Bool
    surface: mi.SurfaceInteraction3f
    number: mi.UInt32
    kind: mi.UInt32
    sample: mi.BSDFSample3f = None
    factor: mi.Color3f = None


class Scene(View):
    """A view with bodies of grains; types of grain are counted through all of them.

    chord : `regularised.chord` of the pass by which smooth grains see small lamps wider; None: as they are
    """

    chord = None

    def __init__(self, world, bodies, colours):
        """world : `renderers.mitsuba.world.World`;  bodies : list of `renderers.materials.grains._grains.Grains`;  colours :
        `Colours`"""
        around = [*world.scene.shapes(), *(light for light in world.scene.emitters() if light.get_shape() is None)]
        names = [thing.id() for thing in around]
        packed, types = {}, 0
        for grains in bodies:
            packed |= _shapes(grains, world.unit, types)
            types += len(grains.exemplars.table)
        shapes = {name: of_type.shape for name, of_type in packed.items()}
        kept = {f"around_{number}": thing for number, thing in enumerate(around)}
        scene = mi.load_dict({"type": "scene"} | kept | shapes, optimize=False)
        for thing, name in zip(around, names):  # which loading has changed
            thing.set_id(name)
        super().__init__(world, scene, colours)
        table = np.concatenate([grains.exemplars.table for grains in bodies])
        self._number(scene, packed, world, np.append(False, table[:, 0] == DIELECTRIC))
        self._size = dr.opaque(mi.Float, max(float(grains.aggregate.radii.max()) * grains.unit / world.unit for grains in bodies))
        self._surfaces = {int(kind) for kind in table[:, 0]}
        self._surface, self._index = mi.UInt32(table[:, 0].astype(np.uint32)), mi.Float(table[:, 1].astype(np.float32))
        channels = np.concatenate([grains.channels for grains in bodies]).astype(float)
        perfect = ~np.isfinite(channels).all(axis=1)
        channels[:, 0][perfect], channels[:, 1][perfect] = 0.0, 1.0  # reflects all light, at any angle
        absorption = np.concatenate([grains.absorption * world.unit / grains.unit for grains in bodies])
        self._channels = [[mi.Float(column.astype(np.float32)) for column in rows.T] for rows in np.moveaxis(channels, 1, 0)]
        self._absorption = [mi.Float(column.astype(np.float32)) for column in absorption.T] if absorption.any() else None

    def _number(self, scene, packed, world, clear):
        """Numbers the grains, from 1, shape by shape;  packed : `Packed` by names of shapes;  clear : of types, from 1"""
        numbers = {shape.id(): int(dr.reinterpret_array(mi.UInt32, mi.ShapePtr(shape))[0]) for shape in scene.shapes()}
        of_shape = np.zeros((3, max(numbers.values(), default=0) + 1), np.uint32)  # first grain, type, parts of a grain
        of_grain = [np.zeros((6, 1))]  # type, shape, first grain there; radius and centre
        for name, (_, kind, parts, centre, radius) in packed.items():
            first = sum(part.shape[1] for part in of_grain)
            of_shape[:, numbers[name]] = first, 1 + kind, parts
            of_grain.append(np.concatenate([np.tile([[1 + kind], [numbers[name]]], len(radius)), [radius], centre.T]))
        kind, shape, radius, *centre = np.concatenate(of_grain, axis=1)
        self._of_shape = [mi.UInt32(column) for column in of_shape]
        self.kind_of, self._shape = (mi.UInt32(column.astype(np.uint32)) for column in (kind, shape))
        self._balls = [mi.Float(column.astype(np.float32)) for column in (radius, *centre)]
        away = np.linalg.norm(np.array(centre) - (np.asarray(world.camera.origin) / world.unit)[:, None], axis=0)
        self.around_camera = int(np.argmax(away < radius))
        self._clear = self.around_camera > 0 or bool(np.any(clear[kind.astype(int)] & (radius > 0)))

    def way_out(self, number, origin, direction):
        """Distances at which rays leave balls that they are in, by their numbers; inf where that is no ball."""
        if not self._clear:  # no ray is in a ball
            return mi.Float(dr.inf)
        radius, *centre = (dr.gather(mi.Float, column, number) for column in self._balls)
        to = origin - mi.Point3f(centre)
        along = dr.dot(to, direction)
        half = dr.safe_sqrt(dr.square(radius) - dr.squared_norm(to - along * direction))
        return dr.select(radius > 0, dr.maximum(half - along, 0), dr.inf)

    def reached(self, ray, number, active):
        """What rays in grains, by their numbers, or in none meet first."""
        hit = self.scene.ray_intersect_preliminary(ray, coherent=False, active=active)
        hit.t = self._to_ball(ray, hit, active)
        if not self._clear:
            return hit
        end = self.way_out(number, ray.o, ray.d)
        leaves = active & (end < dr.select(hit.is_valid(), hit.t, dr.inf))
        shape = dr.gather(mi.UInt32, self._shape, number)
        hit.valid |= leaves
        hit.t = dr.select(leaves, end, hit.t)
        hit.prim_index = dr.select(leaves, number - dr.gather(mi.UInt32, self._of_shape[0], shape, leaves), hit.prim_index)
        hit.shape = dr.select(leaves, dr.reinterpret_array(mi.ShapePtr, shape), hit.shape)
        return hit

    def _to_ball(self, ray, hit, active):
        """Distances to what is hit: `ellipsoids` says them with an error of 3 % of a radius where balls are far and small."""
        number, _ = self.met(hit, active & hit.is_valid())
        radius, *centre = (dr.gather(mi.Float, column, number) for column in self._balls)
        to = mi.Point3f(centre) - ray.o
        along = dr.dot(to, ray.d)
        half = dr.safe_sqrt(dr.square(radius) - dr.squared_norm(to - along * ray.d))
        return dr.select(radius > 0, dr.maximum(along - half, 0), hit.t)

    def beside(self, meeting, towards):
        """Where rays begin that go on from surfaces; towards : in the frame of the surface."""
        surface = meeting.surface
        radius, *centre = (dr.gather(mi.Float, column, meeting.number) for column in self._balls)
        point = dr.select(radius > 0, mi.Point3f(centre) + radius * surface.n, surface.p)
        off = _OFF * (dr.max(dr.abs(point)) + self._size)
        return dr.select(meeting.number > 0, point + dr.mulsign(off, towards.z) * surface.n,
                         surface.spawn_ray(surface.to_world(towards)).o)

    def around(self, path, meeting, towards):
        """Numbers of the grains in which paths go on from surfaces; 0 in none."""
        return dr.select(meeting.number > 0, dr.select(towards.z < 0, meeting.number, 0), path.inside)

    def met(self, hit, active):
        """Numbers, from 1, and types, from 1, of the grains that are met; 0 of other surfaces; hit : with shape and primitive"""
        shape = dr.reinterpret_array(mi.UInt32, hit.shape)
        first, kind, parts = (dr.gather(mi.UInt32, column, shape, active) for column in self._of_shape)
        return dr.select(kind > 0, first + hit.prim_index // dr.maximum(parts, 1), 0), kind

    def absorbed(self, throughput, kind, distance):
        """Throughput after a distance in grains of a type, from 1; 0: in none."""
        if self._absorption is None:
            return throughput
        return [weight * dr.exp(-dr.gather(mi.Float, column, kind - 1, kind > 0) * distance)
                for weight, column in zip(throughput, self._absorption)]

    @property
    def cone(self):
        """1/sr, of directions that have no density, by `regularised.chord`."""
        return dr.inv_pi / dr.square(self.chord)

    def widens(self, path, meeting):
        """Whether the next direction at a meeting is one in which small lamps are seen wider, as `regularised.begin`."""
        return meeting.meets & (path.order > 0) & ~mi.has_flag(meeting.surface.bsdf().flags(), mi.BSDFFlags.Smooth)

    def shares(self, meeting, towards):
        """What surfaces of grains leave of light at each wavelength besides what their white BSDFs say; towards : in the frame
        of the surface.  Grains carry energy: what refraction changes of radiance is taken back."""
        is_grain, ahead = meeting.kind > 0, meeting.surface.wi
        surface = dr.gather(mi.UInt32, self._surface, meeting.kind - 1, is_grain)
        shares = [mi.Float(1)] * self.waves
        if DIELECTRIC in self._surfaces:
            index = dr.gather(mi.Float, self._index, meeting.kind - 1, is_grain)
            index = dr.select(ahead.z > 0, index, dr.rcp(index))
            refracted = is_grain & (surface == DIELECTRIC) & (ahead.z * towards.z < 0)
            shares = [dr.select(refracted, index * index, 1)] * self.waves
        for kind, share in ((DIFFUSE, lambda first, second: first),
                            (CONDUCTOR, lambda n, k: mi.fresnel_conductor(dr.dot(ahead, dr.normalize(ahead + towards)),
                                                                          mi.Complex2f(n, k)))):
            if kind in self._surfaces:
                of_kind = is_grain & (surface == kind)
                shares = [dr.select(of_kind, share(*(dr.gather(mi.Float, row[wave], meeting.kind - 1, of_kind)
                                                     for row in self._channels)), before) for wave, before in enumerate(shares)]
        return shares


def _shapes(grains, unit, first):
    """`Packed` of the grains of a body, by names of shapes; types are counted from `first`."""
    packed, scale, shapes = listed(grains), grains.unit / unit, {}
    for kind, row in enumerate(grains.exemplars.table):
        bsdf, corners = mi.load_dict(_bsdf(*row[:3])), exemplar_mesh(grains, kind)
        centre, radius, _, turn = (values[packed.kind == kind] for values in packed)
        centre, radius = scale * centre, scale * radius
        if not len(radius):
            continue
        if corners is None:
            shape, parts, radius = _balls(centre, radius * row[3], bsdf), 1, radius * row[3]
        else:
            vertices, faces = np.unique(corners.reshape(-1, 3).astype(np.float32), axis=0, return_inverse=True)
            placed = np.einsum("nab,vb->nva", radius[:, None, None] * turn, vertices) + centre[:, None]
            every = faces.reshape(-1) + len(vertices) * np.arange(len(radius))[:, None]
            shape = mesh("grains", placed.reshape(-1, 3), every.reshape(-1, 3), bsdf)
            parts, radius = len(corners), 0 * radius
        shapes[f"grains_{first + kind}"] = Packed(shape, first + kind, parts, centre, radius)
    return shapes


def _balls(centre, radius, bsdf):
    """Mitsuba's shape of all of them."""
    some = {name: mi.TensorXf(np.array([values], np.float32)) for name, values in
            (("centers", [0, 0, 0]), ("scales", [1, 1, 1]), ("quaternions", [0, 0, 0, 1]))}
    shape = mi.load_dict({"type": "ellipsoids", "extent": 1.0, "bsdf": bsdf} | some)
    turn, scales = np.tile([0.0, 0.0, 0.0, 1.0], (len(radius), 1)), np.repeat(radius[:, None], 3, axis=1)
    values = mi.traverse(shape)  # tensors of three rows would be taken for colours, with words on the terminal
    values["data"] = np.concatenate([centre, scales, turn], axis=1).astype(np.float32).ravel()
    values.update()
    return shape


def _bsdf(surface, index, roughness):
    """Of a white surface."""
    rough = {"distribution": "ggx", "alpha": float(roughness)} if roughness > 0.0 else {}
    if surface == DIFFUSE:
        return {"type": "diffuse", "reflectance": {"type": "rgb", "value": 1.0}}
    if surface == CONDUCTOR:
        return {"type": "roughconductor" if rough else "conductor", "material": "none"} | rough
    return {"type": "roughdielectric" if rough else "dielectric", "int_ior": float(index), "ext_ior": 1.0} | rough


def fit(world, bodies) -> bool:
    """Whether grains that paths meet one by one, `renderers.materials.grains.paths.Explicit` of all bodies, can be shapes of a
    world."""
    if any(shape.class_name() == "Instance" for shape in world.scene.shapes()):  # their groups cannot be asked for
        return False
    # of all bodies, before the grains of any are counted
    if any(type(body) is not Explicit or _most(body.grains) > _SEARCHED for body in bodies):
        return False
    balls = clear = triangles = 0
    for body in bodies:
        table, grains = body.grains.exemplars.table, body.grains
        if np.any((table[:, 0] == DIELECTRIC) & (table[:, 1] == 1.0) & (table[:, 2] > 0.0)):  # Mitsuba has no such facets
            return False
        aggregate = grains.aggregate
        reach = np.abs([aggregate.low, aggregate.low + aggregate.voxels.shape * aggregate.edge]).max() + aggregate.radii.max()
        if _OFF * reach > _OFF_RADIUS * aggregate.radii.min() or not _near(world, grains):
            return False
        numbers = np.bincount(listed(grains).kind, minlength=len(table))
        balls += int(numbers[table[:, 3] > 0.0].sum())
        clear += int(numbers[(table[:, 3] > 0.0) & (table[:, 0] == DIELECTRIC)].sum())
        triangles += sum(int(number) * len(exemplar_mesh(grains, kind)) for kind, number in enumerate(numbers)
                         if number and table[kind, 3] == 0.0)
    return balls <= _BALLS and clear <= _CLEAR and triangles <= _TRIANGLES


def _near(world, grains):
    """Whether Mitsuba's single precision hits the balls of a body where they are."""
    balls = grains.exemplars.table[:, 3]
    if not np.any(balls > 0.0):
        return True
    aggregate, scale = grains.aggregate, grains.unit / world.unit
    low, high = scale * aggregate.low, scale * (aggregate.low + aggregate.voxels.shape * aggregate.edge)
    radius = scale * aggregate.radii.min() * balls[balls > 0.0].min()
    camera = np.asarray(world.camera.origin) / world.unit
    away = max(np.linalg.norm(high - low), np.linalg.norm(np.maximum(abs(camera - low), abs(camera - high))))
    return radius >= _LEAST and away <= _NEAR * radius * min(radius, 1.0)


def _most(grains):
    """Grains in the box around a body: there are no more."""
    aggregate = grains.aggregate
    return len(aggregate.radii) * float(np.prod(aggregate.voxels.shape * aggregate.edge / aggregate.cell))


# ---- the loop


def begin(scene, path):
    """The camera's paths, on no grain."""
    return Path(**vars(path), grain=dr.zeros(mi.UInt32, dr.width(path.alive)))


def advance(scene, path, records=None):
    """Paths after a flight to the next surface, and which."""
    ray = mi.Ray3f(path.origin, path.direction)
    hit = scene.reached(ray, path.inside, path.alive)
    meets = path.alive & hit.is_valid()
    surface = hit.compute_surface_interaction(ray, mi.RayFlags.All, path.alive)
    number, kind = scene.met(surface, meets)
    leaves = dr.dot(ray.d, surface.n) > 0
    around = dr.select(kind > 0, dr.select(leaves, kind, 0), dr.gather(mi.UInt32, scene.kind_of, path.inside))
    path.throughput = scene.absorbed(path.throughput, around, dr.select(meets, hit.t, 0))
    path.order += dr.select((number > 0) & (number != path.grain), mi.UInt32(1), mi.UInt32(0))
    path.grain = number
    return path, Meeting(meets, path.alive & ~meets, surface, number, kind)


def next_event(scene, path, meeting):
    """Light of light samples by way of surfaces, linear sRGB, and its emitters; draws the next directions of the paths, too."""
    surface, bsdf = meeting.surface, meeting.surface.bsdf()
    active = meeting.meets & (mi.has_flag(bsdf.flags(), mi.BSDFFlags.Smooth) | (scene.chord is not None))
    u = [loop.for_light(path), *(path.random.next_float32() for _ in range(4))]
    light, radiance = scene.scene.sample_emitter_direction(surface, mi.Point2f(*u[:2]), False, active)
    active &= (light.pdf > 0) & dr.any(radiance > 0)
    towards = surface.to_local(light.d)
    value, by_bsdf, meeting.sample, meeting.factor = bsdf.eval_pdf_sample(mi.BSDFContext(), surface, towards, u[2],
                                                                          mi.Point2f(*u[3:]), meeting.meets)
    onward, ahead = light.d, light.dist * (1 - mi.math.ShadowEpsilon)
    if scene.chord is not None:  # as `regularised.add_light`
        widened = scene.widens(path, meeting)
        within = dr.squared_norm(meeting.sample.wo - towards) < dr.square(scene.chord)
        by_bsdf = dr.select(widened, scene.cone, by_bsdf)
        value = dr.select(widened, dr.select(within, meeting.factor * scene.cone, 0), value)
        towards = dr.select(widened, meeting.sample.wo, towards)
        onward = dr.select(widened, surface.to_world(towards), onward)
        sky = mi.has_flag(light.emitter.flags(), mi.EmitterFlags.Infinite)
        depth = dr.minimum(2 * dr.rsqrt(dr.pi * light.pdf), scene.chord)  # of the distance, as there
        ahead *= dr.select(widened & ~sky & ~light.delta, 1 - depth, 1)
    radiance *= value * dr.select(light.delta, 1, loop.balance(light.pdf, by_bsdf))
    active &= dr.any(radiance > 0)
    ray = mi.Ray3f(scene.beside(meeting, towards), onward)
    ray.maxt = ahead
    active &= ahead < scene.way_out(scene.around(path, meeting, towards), ray.o, ray.d)
    active &= ~scene.scene.ray_test(ray, active)
    weight = [share * throughput for share, throughput in zip(scene.shares(meeting, towards), path.throughput)]
    return scene.seen(weight, radiance, active), light.emitter


def turned(scene, path, meeting, records=None):
    """Paths with a new direction, from where they have come to, or ended."""
    surface, sample, factor = meeting.surface, meeting.sample, meeting.factor
    factor = scene.reflectance(dr.select(dr.all(dr.isfinite(factor)), factor, 0))
    path.throughput = [weight * share * f for weight, share, f in
                       zip(path.throughput, scene.shares(meeting, sample.wo), factor)]
    path.squared_index *= loop.squared_index(sample)
    path.origin, path.direction = scene.beside(meeting, sample.wo), surface.to_world(sample.wo)
    path.drawn, path.inside = mi.Point3f(path.origin), scene.around(path, meeting, sample.wo)
    path.single, path.density = ~mi.has_flag(sample.sampled_type, mi.BSDFFlags.Smooth), sample.pdf
    if scene.chord is not None:
        widened = scene.widens(path, meeting)
        path.single, path.density = path.single & ~widened, dr.select(widened, scene.cone, path.density)
    path.bounces += mi.UInt32(1)
    path.alive &= meeting.meets
    path = loop.roulette(path, path.bounces > _FAR, mi.Float(1), path.random.next_float32())
    path.grain = dr.select(path.alive, path.grain, 0)
    return path


TURN = state.Turn(begin, advance, next_event, turned)


def part(name, world, bodies, colours, seed, angle=0.0):
    """Passes of paths among grains that are shapes; parameters as those of `Scene`, seed of the random numbers of all passes;
    angle : half that of the cone in which small lamps are seen at first, rad."""
    scene = cache(lambda: Scene(world, bodies, colours))
    traced = cache(lambda: passes.recorded(scene(), TURN))  # with the first pass
    plain = passes.of_loop(name, world, lambda *arguments: traced()(*arguments), seed, True, _SAMPLES, _PATHS)
    return _widened(plain, scene, angle) if angle > 0 else plain


def _widened(part, scene, angle):
    def render(number):
        scene().chord = dr.opaque(mi.Float, regularised.chord(angle, (number + 1) * part.samples))
        return part.render(number)

    return part._replace(render=render, fewer=part.fewer and (lambda samples: _widened(part.fewer(samples), scene, angle)))
