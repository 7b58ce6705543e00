"""Where light of a point is refracted towards a point in a body through several smooth boundaries: that of the body, then panes.

A pane is a mesh of smooth glass that holds no medium: a tumbler around milk, a window.  A ray from the point x in the body is
refracted at each boundary that it comes to, with its derivatives by the first direction (ray differentials: Igehy, SIGGRAPH
1999), and Newton's method turns that direction until the ray meets the point y.  It begins with the direction that a boundary
with the index of the body over that around y would ask for (`manifold`), which is the solution where boundaries are parallel.
The walk is the same for the same points, so that of any way from x to y by refractions alone one can tell whether it ends there.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr

import renderers.mitsuba  # noqa: F401  before mitsuba: it finds LLVM

import mitsuba as mi  # isort: skip

# of Newton's method, and rays of all of them together: in the shipped glass of milk 86 of 100 walks end, after one to three
# steps; most of the others would have to go where light is totally reflected
_STEPS, _RAYS = 6, 48
# of the way, that a ray may pass by y, as the last step needs no ray; and of coordinates, what rounding makes of it
_CLOSE, _ROUNDING = 1e-3, 3e-6
_STRIDE = 0.5  # radians: the longest step
# of the way, and of coordinates and 1: places so near are one (`manifold`)
_SAME, _OFF = 2e-3, 3e-4


@dataclass
class Refraction:
    """Ways from x over places on boundaries to y, on which Newton's method walks.

    towards : unit, from x;  within, length : to the first boundary, and to the last
    origin, direction : of the next ray, or the last;  point, normal : where it begins, of the triangle there
    place_s, place_t, turn_s, turn_t : derivatives of point and direction by the first direction, along the axes of its frame
    beyond : from the last boundary to y;  area : at y, at right angles to the way, a solid angle at x
    transmitted, squared : Fresnel's transmittances, and the squares of indices, multiplied;  sigma : least extinction in the body
    boundaries, rays, steps : so far: of this ray, of all, of Newton's method
    active : whether the walk goes on;  ends : at y
    """

    towards: mi.Vector3f
    within: mi.Float
    length: mi.Float
    origin: mi.Point3f
    direction: mi.Vector3f
    point: mi.Point3f
    normal: mi.Vector3f
    place_s: mi.Vector3f
    place_t: mi.Vector3f
    turn_s: mi.Vector3f
    turn_t: mi.Vector3f
    beyond: mi.Float
    area: mi.Float
    transmitted: mi.Float
    squared: mi.Float
    sigma: mi.Float
    boundaries: mi.UInt32
    rays: mi.UInt32
    steps: mi.UInt32
    active: mi.Bool
    ends: mi.Bool

    @property
    def inward(self):
        """Unit, from the first boundary to x."""
        return -self.towards

    @property
    def outward(self):
        """Unit, from the last boundary to y."""
        return self.direction

    def solid_angle(self, normal):
        """Of an area at y with a normal, as seen from x, over the area."""
        return dr.abs(dr.dot(normal, self.direction)) / self.area

    def passes(self):
        """What the boundaries make of radiance on its way to x."""
        return self.transmitted * self.squared

    def likely(self):
        """About the probability that a path from x comes to the first boundary and is refracted at each."""
        return self.transmitted * dr.exp(-self.sigma * self.within)

    def is_at(self, position):
        """Whether it leads over a point, or one where Mitsuba starts a ray from there, to y: then it is the same all the way."""
        return dr.norm(position - self.point) < _SAME * self.length + _OFF * (1 + dr.max(dr.abs(position)))


class Refractions:
    """Walks through boundaries of bodies and panes."""

    def __init__(self, scene, manifold):
        """scene : of Mitsuba;  manifold : `manifold.Manifold` of bodies and panes"""
        self._scene, self._manifold = scene, manifold

    def walk(self, x, y, active):
        """`Refraction` from x, in bodies, to y."""
        towards = self._manifold.walk(x, y, active).direction
        width, zero = dr.width(active), dr.zeros(mi.Float, dr.width(active))
        none, count = dr.zeros(mi.Vector3f, width), dr.zeros(mi.UInt32, width)
        start = Refraction(towards, zero, mi.Float(zero), mi.Point3f(x), mi.Vector3f(towards), mi.Point3f(x), none,
                           *(mi.Vector3f(none) for _ in range(4)), *(mi.Float(zero) for _ in range(5)), count, mi.UInt32(count),
                           mi.UInt32(count), active & dr.all(dr.isfinite(towards)), dr.full(mi.Bool, False, width))
        return dr.while_loop((_started(start, x),), lambda walk: walk.active, lambda walk: (self._stepped(walk, x, y),),
                             label="refractions")[0]

    def _stepped(self, walk, x, y):
        ray = mi.Ray3f(walk.origin, walk.direction)
        hit = self._scene.ray_intersect_preliminary(ray, coherent=False, active=walk.active)
        of_body, of_pane = self._manifold.rows(hit)
        row = dr.select(walk.active & hit.is_valid(), dr.select(walk.boundaries == 0, of_body, of_pane), 0)
        ahead = dr.dot(y - walk.point, walk.direction)
        # what else is in the way hides y, or not, when the walk has ended
        meets = (row > 0) & ((walk.boundaries == 0) | (hit.t < ahead))
        arrives = walk.active & ~meets & (walk.boundaries > 0) & (ahead > 0)
        walk.rays += 1
        refracted, transmits = self._refracted(walk, dr.select(meets, row, 0), hit.prim_uv)
        corrected = _corrected(walk, y, ahead)
        goes_on = arrives & ~corrected.ends & (walk.steps < _STEPS) & dr.all(dr.isfinite(corrected.towards))
        ended = arrives & corrected.ends
        active = (meets & transmits | goes_on) & (walk.rays < _RAYS)
        new = _started(corrected, x)
        for name in vars(walk):
            kept = dr.select(arrives, getattr(corrected, name), getattr(walk, name))
            onward = dr.select(meets & transmits, getattr(refracted, name), getattr(new, name))
            setattr(walk, name, dr.select(active, onward, kept))
        walk.active, walk.ends = active, ended
        return walk

    def _refracted(self, walk, row, uv):
        """Walks beyond a boundary, and whether they go on there."""
        at = self._manifold.at(row, uv)
        scale = dr.rsqrt(dr.squared_norm(at.normal))
        triangle, shading, direction = dr.normalize(dr.cross(at.edge_u, at.edge_v)), at.normal * scale, walk.direction
        leaves = dr.dot(shading, direction) > 0
        ratio = dr.select(leaves, at.index, dr.rcp(at.index))  # of indices, here over there
        side = dr.select(leaves, mi.Float(-1), mi.Float(1))
        n = side * shading
        cosine = -dr.dot(direction, n)
        square = 1 - dr.square(ratio) * (1 - dr.square(cosine))
        cosine_there = dr.sqrt(dr.maximum(square, 1e-12))
        mu = ratio * cosine - cosine_there
        onward = dr.normalize(ratio * direction + mu * n)
        through = dr.dot(triangle, direction)
        transmits = (square > 1e-6) & (side * through < 0) & (side * dr.dot(triangle, onward) < 0)
        length = dr.dot(at.point - walk.point, direction)
        whole = dr.cross(at.edge_u, at.edge_v)
        over = dr.rcp(dr.squared_norm(whole))

        def beyond(shift, turn):
            shift = shift + length * turn
            shift = shift - direction * (dr.dot(triangle, shift) / through)
            u = dr.dot(dr.cross(shift, at.edge_v), whole) * over
            v = dr.dot(dr.cross(at.edge_u, shift), whole) * over
            change = (at.turn_u * u + at.turn_v * v) * (side * scale)
            change = change - n * dr.dot(n, change)
            d_cosine = -dr.dot(turn, n) - dr.dot(direction, change)
            return shift, ratio * turn + (ratio - dr.square(ratio) * cosine / cosine_there) * d_cosine * n + mu * change

        place_s, turn_s = beyond(walk.place_s, walk.turn_s)
        place_t, turn_t = beyond(walk.place_t, walk.turn_t)
        first = walk.boundaries == 0
        origin = mi.Interaction3f(0.0, 0.0, dr.zeros(mi.Color0f), at.point, triangle).spawn_ray(onward).o
        return Refraction(walk.towards, dr.select(first, length, walk.within), walk.length + length, origin, onward, at.point,
                          triangle, place_s, place_t, turn_s, turn_t, walk.beyond, walk.area,
                          walk.transmitted * (1 - mi.fresnel(-dr.dot(shading, direction), at.index)[0]),
                          walk.squared * dr.square(ratio), dr.select(first, at.sigma, walk.sigma), walk.boundaries + 1, walk.rays,
                          walk.steps, mi.Bool(walk.active), mi.Bool(walk.ends)), transmits


def _corrected(walk, y, ahead):
    """Walks that have come to y, or by it: with the direction of the next step."""
    frame, first = mi.Frame3f(walk.direction), mi.Frame3f(walk.towards)
    miss = frame.to_local(y - walk.point - ahead * walk.direction)
    along_s, along_t = (frame.to_local(shift + ahead * turn) for shift, turn in ((walk.place_s, walk.turn_s),
                                                                                (walk.place_t, walk.turn_t)))
    area = along_s.x * along_t.y - along_s.y * along_t.x
    s, t = (miss.x * along_t.y - miss.y * along_t.x) / area, (along_s.x * miss.y - along_s.y * miss.x) / area
    less = dr.minimum(1, _STRIDE * dr.rsqrt(dr.maximum(s * s + t * t, 1e-30)))
    ends = dr.hypot(miss.x, miss.y) < _CLOSE * ahead + _ROUNDING * dr.max(dr.abs(y))
    values = dict(vars(walk), beyond=ahead, area=dr.abs(area), ends=ends, steps=walk.steps + 1)
    values["towards"] = dr.normalize(walk.towards + less * (s * first.s + t * first.t))
    values["point"] = walk.point + dr.select(ends, s, 0) * walk.place_s + dr.select(ends, t, 0) * walk.place_t
    values["direction"] = dr.select(ends, dr.normalize(y - values["point"]), walk.direction)
    return Refraction(**values)


def _started(walk, x):
    """Walks that begin at x with the direction that they have now."""
    frame, width = mi.Frame3f(walk.towards), dr.width(walk.towards)
    zero, none, unit = dr.zeros(mi.Float, width), dr.zeros(mi.Vector3f, width), dr.full(mi.Float, 1, width)
    values = dict(vars(walk), within=zero, length=mi.Float(zero), origin=mi.Point3f(x), direction=mi.Vector3f(walk.towards),
                  point=mi.Point3f(x), place_s=none, place_t=mi.Vector3f(none), turn_s=frame.s, turn_t=frame.t,
                  transmitted=unit, squared=mi.Float(unit), boundaries=dr.zeros(mi.UInt32, width))
    return Refraction(**values)
