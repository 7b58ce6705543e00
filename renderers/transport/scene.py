"""What a loop of Dr.Jit asks of a Mitsuba scene with bodies: camera, boundaries, media in between, colours."""

from __future__ import annotations

import drjit as dr
import numpy as np

from renderers.transport.media import Media

import mitsuba as mi  # isort: skip

# of the size of bodies: nearer boundaries may coincide
_TOUCH = 1e-4
# of the largest coordinate, of the point or of the bodies: a path goes on beyond a boundary to which light is blind.  A boundary
# that it meets again is harmless where each step leads on; near the origin an offset by the point's coordinates alone does not,
# as triangles are met to within the rounding of their corners
_OFFSET = 4e-7
_BLIND = 1 << 31  # of a shape: light does not see it


class Scene:
    """Surfaces, lights, camera, and bodies of homogeneous media; those inside of others come before them.

    scene : of Mitsuba;  media : `Media`, one a body
    around_camera : bodies in which the camera stands, a bit each
    """

    def __init__(self, world, bodies, colours, around_camera):
        """
        Parameters
        ----------
        world : `renderers.mitsuba.world.World`
        bodies : at most 31, each with name, vertices, faces, medium, matched as a `renderers.translucent.bodies.Body` has them
        colours : to_rgb (3, L) and to_waves (L, 3)
        around_camera : names of the bodies in which the camera stands
        """
        bodies = sorted(bodies, key=lambda body: _volume(body.vertices, body.faces))
        unit = world.unit
        self.scene, self.media = world.scene, Media([body.medium for body in bodies], unit)
        self._matched = mi.UInt32([int(body.matched) for body in bodies])
        self._shapes = _numbers(world, bodies)
        self._apart = [_alone(body, unit) for body in bodies] if needs_search(world, bodies) else []
        corners = np.concatenate([body.vertices for body in bodies]) / unit
        self._farthest = mi.Float(float(abs(corners).max()))
        self._low, self._high, *self._camera = (mi.Point3f(*row) for row in (
            corners.min(axis=0).tolist(), corners.max(axis=0).tolist(), *_camera(world.camera, unit).tolist()))
        self._to_rgb, self._to_waves = _entries(colours.to_rgb), _entries(colours.to_waves)
        self._width = mi.UInt32(world.size[1])
        self.around_camera = mi.UInt32(sum(1 << number for number, body in enumerate(bodies)
                                           if body.name in around_camera))
        dr.make_opaque(self._farthest, self._low, self._high, self._camera, self._width, self.around_camera)

    def camera_ray(self, pixel, offset):
        """Origin and direction through pixels, numbered by rows, at places in them."""
        origin, corner, right, down = self._camera
        row = pixel // self._width
        column = pixel - row * self._width
        on_film = corner + (mi.Float(column) + offset.x) * right + (mi.Float(row) + offset.y) * down
        return origin + dr.zeros(mi.Point3f, dr.width(pixel)), dr.normalize(mi.Vector3f(on_film))

    def innermost(self, inside):
        """Whether paths are in a body, and the number of its medium."""
        within = inside != 0
        return within, dr.select(within, dr.tzcnt(inside), 0)

    def near_bodies(self, point):
        """Whether points are where bodies may be; rounding can lose a path through an edge."""
        return dr.all((point >= self._low) & (point <= self._high))

    def is_blind(self, shape):
        """Whether light does not see a shape."""
        return (self._number(shape) & _BLIND) != 0

    def takes_samples(self, medium):
        """Whether light samples reach scatterings in a medium: its boundary lets them through."""
        return dr.gather(mi.UInt32, self._matched, medium) != 0

    def beyond(self, surface, direction, inside, active):
        """Bodies in which paths are that go on from a surface."""
        if self._apart:
            return self._searched(self.across(surface, direction), direction, active)
        number = self._number(surface.shape) & (_BLIND - 1)
        bit = dr.select(number > 0, mi.UInt32(1) << (dr.maximum(number, 1) - 1), mi.UInt32(0))
        return dr.select(dr.dot(surface.n, direction) < 0, inside | bit, inside & ~bit)

    def across(self, surface, direction):
        """Where paths go on beyond a boundary to which light is blind."""
        off = _OFFSET * dr.maximum(dr.max(dr.abs(surface.p)), self._farthest)
        return surface.p + dr.mulsign(mi.Vector3f(surface.n) * off, dr.dot(surface.n, direction))

    def transmittance(self, ray, inside, active):
        """What media leave of light along rays, of each wavelength; 0 where a surface is in between."""
        def step(ray, inside, depth, active):
            hit = self.scene.ray_intersect_preliminary(ray, coherent=False, active=active)
            within, medium = self.innermost(inside)
            meets = active & hit.is_valid()
            far = dr.select(active & within, dr.select(meets, hit.t, ray.maxt), 0)
            depth = [d + sigma * far for d, sigma in zip(depth, self.media.sigma_t(medium))]
            crosses = meets & self.is_blind(hit.shape)
            depth[0] = dr.select(meets & ~crosses, dr.inf, depth[0])
            surface = hit.compute_surface_interaction(ray, mi.RayFlags.Minimal, crosses)
            ray.o = dr.select(crosses, self.across(surface, ray.d), ray.o)
            ray.maxt = dr.select(crosses, ray.maxt - hit.t, ray.maxt)
            inside = dr.select(crosses, self.beyond(surface, ray.d, inside, crosses), inside)
            return ray, inside, depth, crosses & (ray.maxt > 0)

        depth = [dr.zeros(mi.Float, dr.width(active)) for _ in range(self.media.count)]
        depth = dr.while_loop((ray, inside, depth, active), lambda ray, inside, depth, active: active, step,
                              label="shadow rays")[2]
        free = depth[0] < dr.inf
        return [dr.select(free, dr.exp(-d), 0) for d in depth]

    def seen(self, throughput, radiance, active):
        """What throughput of each wavelength makes of radiance, both as linear sRGB."""
        waves = [weight * wave for weight, wave in zip(throughput, _times(self._to_waves, radiance))]
        return [dr.select(active & dr.isfinite(value), value, 0) for value in _times(self._to_rgb, waves)]

    def reflectance(self, colour):
        """Of each wavelength, of what is linear sRGB."""
        return _times(self._to_waves, colour)

    def _number(self, shape):
        return dr.gather(mi.UInt32, self._shapes, dr.reinterpret_array(mi.UInt32, shape))

    def _searched(self, origin, direction, active):
        """Bodies around points: those whose own boundary, on the way, is left before it is entered."""
        inside = dr.zeros(mi.UInt32, dr.width(origin))
        for number, scene in enumerate(self._apart):
            ray = mi.Ray3f(origin, direction)
            surface = scene.ray_intersect(ray, mi.RayFlags.Minimal, False, active)
            leaves = active & surface.is_valid() & (dr.dot(surface.n, direction) > 0)
            inside |= dr.select(leaves, mi.UInt32(1 << number), mi.UInt32(0))
        return inside


def needs_search(world, bodies):
    """Whether a crossing does not tell which bodies a path is in, so that it is searched for among the boundaries of each.

    So it is where boundaries may coincide, of which a ray meets one, and where a mesh is not turned outward.
    """
    shapes = {shape.name: shape for shape in world.shapes()}
    boxes = [np.array([body.vertices.min(axis=0), body.vertices.max(axis=0)]) for body in bodies]
    slack = _TOUCH * max(float(np.ptp(box, axis=0).max()) for box in boxes)
    touch = any(np.all((a[0] <= b[1] + slack) & (b[0] <= a[1] + slack)) for k, a in enumerate(boxes) for b in boxes[:k])
    return touch or not all(_outward(shapes[body.name], body) for body in bodies)


def _outward(shape, body):
    """Whether Mitsuba's mesh of a body is turned as its boundary is."""
    wanted = _volume(body.vertices, body.faces)
    return not shape.flipped and abs(_volume(shape.vertices, shape.faces) - wanted) <= 1e-6 * wanted


def _volume(vertices, faces):
    corner = (vertices - vertices.mean(axis=0))[faces]
    return float(np.einsum("fk,fk->", corner[:, 0], np.cross(corner[:, 1], corner[:, 2]))) / 6


def _alone(body, unit):
    """A scene of nothing but the boundary of a body."""
    mesh = mi.Mesh(body.name, len(body.vertices), len(body.faces))
    values = mi.traverse(mesh)
    values["vertex_positions"] = (body.vertices / unit).astype(np.float32).ravel()
    values["faces"] = body.faces.astype(np.uint32).ravel()
    values.update()
    return mi.load_dict({"type": "scene", "body": mesh})


def _numbers(world, bodies):
    """Of each shape, by Dr.Jit's numbers: its body's, from 1, and `_BLIND` where light does not see it."""
    names, shapes = [body.name for body in bodies], world.scene.shapes()
    numbers = [int(dr.reinterpret_array(mi.UInt32, mi.ShapePtr(shape))[0]) for shape in shapes]
    table = np.zeros(max(numbers, default=0) + 1, np.uint32)
    for number, shape in zip(numbers, shapes):
        table[number] = names.index(shape.id()) + 1 if shape.id() in names else 0
        bsdf = shape.bsdf()
        if mi.has_flag(bsdf.flags(), mi.BSDFFlags.Null) and not len(mi.traverse(bsdf).keys()):
            table[number] |= _BLIND
    return mi.UInt32(table)


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
