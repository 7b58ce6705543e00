"""Where light of a point outside of a body is refracted towards a point in it, through smooth boundaries.

From a point x in a body and a point y outside a walk on the boundary looks for the place z where Snell's law holds (Newton's
method on the half vector, each step brought back to the boundary by a ray from x: Hanika, Droske and Fascione, EGSR 2015;
Zeltner, Georgiev and Jakob, SIGGRAPH 2020).  It begins where the straight way to y leaves the body and is the same for the same
points, so that of any way x, z, y one can tell whether it ends there.  The law is that of the normals that shade, of which
Mitsuba's `dielectric` makes directions; distances and areas are those of the triangles.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import numpy as np

from renderers.mitsuba.shading import by_number, single

import mitsuba as mi  # isort: skip

_STEPS = 8  # rays of a walk; in the shipped candle 85 to 95 of 100 walks need three to five, 1 of 100 ends nowhere
# what may be left of the tangential part of the half vector, whose length is about 1, and of what rounding of points makes of it
_CLOSE, _ROUNDING = 1e-4, 3e-7
_STRIDE = 1.0  # of the distance to the boundary: the longest step along it
# of the distance to x, and of coordinates and 1: places so near are one.  Mitsuba starts rays a third of the latter off surfaces
_SAME, _OFF = 2e-3, 3e-4
_CROSSED = 16  # other surfaces in the way of the boundary that tells whether a point is in a body, at most
_COLUMNS = 20  # of the table of triangles, in packets of four


@dataclass
class Bend:
    """A way from x over a place on the boundary to y.

    point : the place;  normal : of its triangle
    inward, outward : unit, from there to x and y;  within, beyond : distances to them
    cosine_in, cosine_out : of these directions with the shading normal, turned so that both are positive of refracted light
    index : refractive index inside over that outside;  sigma : least extinction in the body
    fault : tangential part of the half vector;  along_u, along_v : its derivatives along edges of the triangle
    edge_u, edge_v : these edges
    """

    point: mi.Point3f
    normal: mi.Vector3f
    inward: mi.Vector3f
    outward: mi.Vector3f
    within: mi.Float
    beyond: mi.Float
    cosine_in: mi.Float
    cosine_out: mi.Float
    index: mi.Float
    sigma: mi.Float
    fault: mi.Vector2f
    along_u: mi.Vector2f
    along_v: mi.Vector2f
    edge_u: mi.Vector3f
    edge_v: mi.Vector3f

    def is_solution(self):
        size = dr.max(dr.abs(self.point))
        return dr.norm(self.fault) < _CLOSE + _ROUNDING * size * (self.index / self.within + 1 / self.beyond)

    def step(self):
        """Newton's, along the boundary."""
        scale = dr.rcp(_determinant(self.along_u, self.along_v))
        u, v = _determinant(self.along_v, self.fault) * scale, -_determinant(self.along_u, self.fault) * scale
        step = u * self.edge_u + v * self.edge_v
        return step * dr.minimum(1, _STRIDE * self.within * dr.rsqrt(dr.maximum(dr.squared_norm(step), 1e-30)))

    def solid_angle(self, normal):
        """Of an area at y with a normal, as seen from x, over the area (implicit derivative of the half vector)."""
        of_boundary = dr.abs(dr.dot(dr.cross(self.edge_u, self.edge_v), self.inward)) / dr.square(self.within)
        of_lamp = self.cosine_out * dr.abs(dr.dot(normal, self.outward)) / dr.square(self.beyond)
        return of_boundary * of_lamp / dr.abs(_determinant(self.along_u, self.along_v))

    def transmits(self):
        """Fresnel's transmittance."""
        return 1 - mi.fresnel(-self.cosine_in, self.index)[0]

    def passes(self):
        """What the boundary makes of radiance on its way to x."""
        return self.transmits() * dr.square(self.index)

    def likely(self):
        """About the probability that a path from x comes to the boundary and is refracted there."""
        return self.transmits() * dr.exp(-self.sigma * self.within)

    def is_at(self, position):
        """Whether it leads over a point, or one where Mitsuba starts a ray from there."""
        return dr.norm(position - self.point) < _SAME * self.within + _OFF * (1 + dr.max(dr.abs(position)))


def refracts(bend):
    """Whether light goes through there from one side to the other, by the shading normal and by the triangle."""
    return (bend.cosine_in > 0) & (bend.cosine_out > 0) & (dr.dot(bend.normal, bend.inward) < 0) \
        & (dr.dot(bend.normal, bend.outward) > 0)


def _determinant(a, b):
    return a.x * b.y - a.y * b.x


@dataclass
class Place:
    """On triangles.

    point : the place;  edge_u, edge_v : of the triangle;  normal : that shades, not normalised
    turn_u, turn_v : its changes along both edges;  index : refractive index inside over that outside;  sigma : least extinction
    """

    point: mi.Point3f
    edge_u: mi.Vector3f
    edge_v: mi.Vector3f
    normal: mi.Vector3f
    turn_u: mi.Vector3f
    turn_v: mi.Vector3f
    index: mi.Float
    sigma: mi.Float


@dataclass
class Walk:
    """Walks on boundaries.

    origin, direction : of the next ray;  steps : rays so far;  active : whether they go on
    row : triangle that the last ray met, from 1, 0 for none;  uv : on it;  ends : at a solution there
    """

    origin: mi.Point3f
    direction: mi.Vector3f
    row: mi.UInt32
    uv: mi.Point2f
    steps: mi.UInt32
    active: mi.Bool
    ends: mi.Bool


class Manifold:
    """Smooth boundaries that refract light.

    box : (low, high) corners of the box around them
    """

    def __init__(self, scene, boundaries, sigma, blind, around=None, panes=()):
        """
        scene : of Mitsuba;  boundaries : `boundaries.Boundaries`
        sigma : least extinction in bodies, by shapes of the scene, meshes with a `dielectric`
        blind : whether there are boundaries to which light is blind
        panes : such shapes that bound no body;  around : by bodies, the index around them over that around lamps
        """
        self._scene, self._boundaries, self._blind = scene, boundaries, blind
        shapes = list(sigma)
        tables = [_triangles(shape, sigma.get(shape, 0.0)) for shape in (*shapes, *panes)]
        firsts = 1 + np.cumsum([0, *map(len, tables)])
        self._firsts = numbered(scene, shapes, firsts[:len(shapes)])
        self._pane_firsts = numbered(scene, panes, firsts[len(shapes):-1])
        self._around = numbered(scene, shapes, [around[shape] for shape in shapes], np.float32) if panes else None
        self._table = single(np.concatenate(tables).ravel())
        corners = np.concatenate(tables[:len(shapes)])[:, :3]
        self.box = corners.min(axis=0), corners.max(axis=0)

    def begins_within(self, ray):
        """Whether rays begin in bodies: the first boundary that they meet, behind whatever else, is one that they leave."""
        def step(ray, active, within, count):
            surface = self._scene.ray_intersect(ray, mi.RayFlags.Minimal, False, active)
            boundary = self._first(surface.shape) > 0
            active = active & surface.is_valid()
            within = within | active & boundary & (dr.dot(surface.n, ray.d) > 0)
            ray.o = dr.select(active, surface.spawn_ray(ray.d).o, ray.o)
            return ray, active & ~boundary & (count < _CROSSED), within, count + 1

        width = dr.width(ray.o)
        start = mi.Ray3f(ray), dr.full(mi.Bool, True, width), dr.full(mi.Bool, False, width), dr.zeros(mi.UInt32, width)
        return dr.while_loop(start, lambda ray, active, within, count: active, step, label="ways out of bodies")[2]

    def walk(self, x, y, active):
        """`Walk` from x, in bodies, to y."""
        width = dr.width(active)
        start = Walk(mi.Point3f(x), dr.normalize(y - x), dr.zeros(mi.UInt32, width), dr.zeros(mi.Point2f, width),
                     dr.zeros(mi.UInt32, width), mi.Bool(active), dr.full(mi.Bool, False, width))
        return dr.while_loop((start,), lambda walk: walk.active, lambda walk: (self._stepped(walk, x, y),),
                             label="walks on boundaries")[0]

    def _stepped(self, walk, x, y):
        ray = mi.Ray3f(walk.origin, walk.direction)
        hit = self._scene.ray_intersect_preliminary(ray, coherent=False, active=walk.active)
        valid, first = walk.active & hit.is_valid(), self._first(hit.shape)
        crosses = mi.Bool(False)
        if self._blind:
            crosses = valid & self._boundaries.is_blind(hit.shape)
            surface = hit.compute_surface_interaction(ray, mi.RayFlags.Minimal, crosses)
            walk.origin = dr.select(crosses, self._boundaries.across(surface, ray.d), walk.origin)
        active = valid & ~crosses & (first > 0)
        walk.row = dr.select(active, first + hit.prim_index, 0)
        walk.uv = hit.prim_uv
        bend = self.bend(walk.row, walk.uv, x, y, self._index_around(hit.shape))
        walk.ends = active & bend.is_solution()
        walk.steps += dr.select(crosses, mi.UInt32(0), mi.UInt32(1))
        towards = dr.normalize(bend.point + bend.step() - x)
        active &= ~walk.ends & dr.all(dr.isfinite(towards))
        walk.direction = dr.select(active, towards, walk.direction)
        active &= walk.steps < _STEPS
        walk.origin = dr.select(active, x, walk.origin)
        walk.active = active | crosses
        return walk

    def at(self, row, uv):
        """`Place` on triangles."""
        packets = _COLUMNS // 4
        columns = [entry for k in range(packets)
                   for entry in dr.gather(mi.Vector4f, self._table, (row - 1) * packets + k, row > 0)]
        corner, edge_u, edge_v, normal, turn_u, turn_v = (mi.Vector3f(*columns[k:k + 3]) for k in range(0, 18, 3))
        return Place(mi.Point3f(corner + uv.x * edge_u + uv.y * edge_v), edge_u, edge_v,
                     normal + uv.x * turn_u + uv.y * turn_v, turn_u, turn_v, *columns[18:])

    def rows(self, hit):
        """Triangles that rays meet, from 1, of bodies, and of panes; 0 of others."""
        first, pane = (dr.gather(mi.UInt32, firsts, dr.reinterpret_array(mi.UInt32, hit.shape))
                       for firsts in (self._firsts, self._pane_firsts))
        return tuple(dr.select(number > 0, number + hit.prim_index, 0) for number in (first, pane))

    def _index_around(self, shape):
        """Index around bodies over that around lamps."""
        return 1.0 if self._around is None else dr.gather(mi.Float, self._around, dr.reinterpret_array(mi.UInt32, shape))

    def bend(self, row, uv, x, y, around=1.0):
        """`Bend` at places on triangles.

        around : factor of the index
        """
        at = self.at(row, uv)
        point, edge_u, edge_v, normal, turn_u, turn_v, sigma = (
            at.point, at.edge_u, at.edge_v, at.normal, at.turn_u, at.turn_v, at.sigma)
        index = at.index * around
        scale = dr.rsqrt(dr.squared_norm(normal))
        frame = mi.Frame3f(normal * scale)
        within, beyond = dr.norm(x - point), dr.norm(y - point)
        inward, outward = (x - point) / within, (y - point) / beyond
        half = index * inward + outward
        depth = dr.dot(half, frame.n) * scale

        def along(edge, turn):
            change = (inward * dr.dot(inward, edge) - edge) * (index / within)
            change += (outward * dr.dot(outward, edge) - edge) / beyond - depth * turn
            return mi.Vector2f(dr.dot(change, frame.s), dr.dot(change, frame.t))

        return Bend(point, dr.normalize(dr.cross(edge_u, edge_v)), inward, outward, within, beyond, -dr.dot(frame.n, inward),
                    dr.dot(frame.n, outward), index, sigma, mi.Vector2f(dr.dot(half, frame.s), dr.dot(half, frame.t)),
                    along(edge_u, turn_u), along(edge_v, turn_v), edge_u, edge_v)

    def _first(self, shape):
        """Row of a shape's first triangle, from 1; 0 of other shapes."""
        return dr.gather(mi.UInt32, self._firsts, dr.reinterpret_array(mi.UInt32, shape))


def numbered(scene, shapes, numbers, kind=np.uint32):
    """Numbers of shapes of a Mitsuba scene, of a kind, by Dr.Jit's numbers for them; 0 of all others."""
    others = scene.shapes()
    table = by_number([*others, *shapes], [0] * len(others) + list(numbers), kind)
    return (mi.Float if kind is np.float32 else mi.UInt32)(table)


def _triangles(shape, sigma):
    """Rows of the table: a corner, two edges, the shading normal there and how it changes along both, index, extinction."""
    faces = np.array(shape.faces_buffer(), np.int64).reshape(-1, 3)
    corners = np.array(shape.vertex_positions_buffer(), float).reshape(-1, 3)[faces]
    edges = corners[:, 1:] - corners[:, :1]
    if shape.has_vertex_normals() and not shape.has_face_normals():
        normals = np.array(shape.vertex_normals_buffer(), float).reshape(-1, 3)[faces]
    else:
        normals = np.repeat(np.cross(edges[:, 0], edges[:, 1])[:, None], 3, axis=1)
        normals /= np.maximum(np.linalg.norm(normals, axis=2, keepdims=True), 1e-300)
    return np.concatenate([corners[:, 0], edges.reshape(-1, 6), normals[:, 0], (normals[:, 1:] - normals[:, :1]).reshape(-1, 6),
                           np.tile([refractive_index(shape), sigma], (len(faces), 1))], axis=1)


def refractive_index(shape):
    """Inside over outside, of a shape with a `dielectric`."""
    return float(np.array(mi.traverse(shape.bsdf())["eta"]).ravel()[0])
