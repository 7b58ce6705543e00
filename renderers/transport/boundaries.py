"""Bodies of a Mitsuba scene for loops of Dr.Jit: which shapes bound them, and which of them a path is in."""

import drjit as dr
import numpy as np

from renderers.mitsuba.shading import by_number
from renderers.mitsuba.shapes import is_null
from renderers.transport.regions import boundary
from renderers.transport.solids import holds, volume

import mitsuba as mi  # isort: skip

# of the size of bodies: nearer boundaries may coincide
_TOUCH = 1e-4
# of the largest coordinate, of the point or of the bodies: a path goes on beyond a boundary to which light is blind.  A boundary
# that it meets again is harmless where each step leads on; near the origin an offset by the point's coordinates alone does not,
# as triangles are met to within the rounding of their corners
_OFFSET = 4e-7
_BLIND = 1 << 31  # of a shape: light does not see it


class Boundaries:
    """Boundaries of bodies, which paths keep a bit each of.

    around_camera : bodies in which the camera stands
    blind : whether there are boundaries that light does not see
    """

    def __init__(self, world, bodies):
        """
        world : `renderers.mitsuba.world.World`
        bodies : by the numbers of their media, each with name, vertices, faces as a `renderers.materials.bodies.bodies.Body`
            has them
        """
        unit = world.unit
        shapes = _numbers(world, {body.name: number for number, body in bodies.items()})
        self._shapes, self.blind = mi.UInt32(shapes), bool(np.any(shapes & np.uint32(_BLIND)))
        self._apart = [(1 << number, boundary(body.vertices, body.faces, unit)) for number, body in bodies.items()] \
            if needs_search(world, list(bodies.values())) else []
        corners = np.concatenate([body.vertices for body in bodies.values()]) / unit if bodies else np.zeros((1, 3))
        self._farthest = mi.Float(float(abs(corners).max()))
        self._low, self._high = mi.Point3f(corners.min(axis=0).tolist()), mi.Point3f(corners.max(axis=0).tolist())
        self.around_camera = mi.UInt32(sum(1 << number for number, body in bodies.items()
                                           if holds(body.vertices, body.faces, world.camera.origin)))
        dr.make_opaque(self._farthest, self._low, self._high, self.around_camera)

    def near(self, point):
        """Whether points are where bodies may be; rounding can lose a path through an edge."""
        return dr.all((point >= self._low) & (point <= self._high))

    def is_blind(self, shape):
        """Whether light does not see a shape."""
        return (self._number(shape) & _BLIND) != 0

    def is_body(self, shape):
        """Whether a shape bounds a body."""
        return (self._number(shape) & (_BLIND - 1)) != 0

    def medium(self, shape):
        """Number of the medium in the body that a shape bounds; 0 of other shapes."""
        return dr.maximum(self._number(shape) & (_BLIND - 1), 1) - 1

    def beyond(self, surface, direction, inside, active):
        """Bodies in which paths are that go on from a surface."""
        if self._apart:
            return self._searched(self.across(surface, direction), direction, active)
        number = self._number(surface.shape) & (_BLIND - 1)
        bit = dr.select(number > 0, mi.UInt32(1) << (dr.maximum(number, 1) - 1), mi.UInt32(0))
        return dr.select(dr.dot(surface.n, direction) < 0, inside | bit, inside & ~bit)

    def outside(self, point, normal, direction, number, inside, active):
        """Bodies in which light is that leaves body `number` there."""
        if self._apart:
            return self._searched(self._past(point, normal, direction), direction, active)
        return inside & ~(mi.UInt32(1) << number)

    def across(self, surface, direction):
        """Where paths go on beyond a boundary to which light is blind."""
        return self._past(surface.p, surface.n, direction)

    def _past(self, point, normal, direction):
        off = _OFFSET * dr.maximum(dr.max(dr.abs(point)), self._farthest)
        return point + dr.mulsign(mi.Vector3f(normal) * off, dr.dot(normal, direction))

    def _number(self, shape):
        return dr.gather(mi.UInt32, self._shapes, dr.reinterpret_array(mi.UInt32, shape))

    def _searched(self, origin, direction, active):
        """Bodies around points: those whose own boundary, on the way, is left before it is entered."""
        inside = dr.zeros(mi.UInt32, dr.width(origin))
        for bit, scene in self._apart:
            ray = mi.Ray3f(origin, direction)
            surface = scene.ray_intersect(ray, mi.RayFlags.Minimal, False, active)
            leaves = active & surface.is_valid() & (dr.dot(surface.n, direction) > 0)
            inside |= dr.select(leaves, mi.UInt32(bit), mi.UInt32(0))
        return inside


def needs_search(world, bodies):
    """Whether a crossing does not tell which bodies a path is in, so that it is searched for among the boundaries of each.

    So it is where boundaries may coincide, of which a ray meets one, and where a mesh is not turned outward.
    """
    if not bodies:
        return False
    shapes = {shape.name: shape for shape in world.shapes()}
    boxes = [np.array([body.vertices.min(axis=0), body.vertices.max(axis=0)]) for body in bodies]
    slack = _TOUCH * max(float(np.ptp(box, axis=0).max()) for box in boxes)
    touch = any(np.all((a[0] <= b[1] + slack) & (b[0] <= a[1] + slack)) for k, a in enumerate(boxes) for b in boxes[:k])
    return touch or not all(_outward(shapes[body.name], body) for body in bodies)


def _outward(shape, body):
    """Whether Mitsuba's mesh of a body is turned as its boundary is."""
    wanted = volume(body.vertices, body.faces)
    return not shape.flipped and abs(volume(shape.vertices, shape.faces) - wanted) <= 1e-6 * wanted


def _numbers(world, bodies):
    """Of each shape, by Dr.Jit's numbers: its body's, from 1, and `_BLIND` where light does not see it.

    bodies : numbers by the names of shapes
    """
    shapes = world.scene.shapes()
    return by_number(shapes, [bodies.get(shape.id(), -1) + 1 + _BLIND * is_null(shape.bsdf()) for shape in shapes])
