"""Rays through a grain by Mitsuba 3: its BSDFs and its ray tracing (Embree) in one compiled loop: `MitsubaWalker`.

Stands in for `walk.Walker` with other random numbers and float32 below: figures agree within their errors.
"""

import functools
from dataclasses import dataclass

import numpy as np

from bakery.physics.grains.sampling import AHEAD, FAINT, enter
from bakery.physics.grains.surface import CONDUCTOR, DIELECTRIC, DIFFUSE, Surface
from bakery.physics.grains.walk import ABSORBED, CONTRADICTED, CUT, EVENTS_MAX, LEFT, MISSED, Paths
from bakery.system import llvm

VARIANT = "llvm_ad_mono"
FORWARD = 1e-5  # rad: changes of direction below count as none; float32 makes up to 3e-6 where there is none
_OFF = 2.0**-21  # R, how far off the surface a ray starts, on the side to which it goes: five roundings of a float32 near 1
_COUNT = 28  # bits for the number of meetings in a path's mark; its status follows
_LANES = 1 << 12  # rays under way at once; each takes the next path when its own has ended


def missing() -> str:
    """Why Mitsuba cannot run here; empty where it can."""
    llvm.find()
    try:
        import drjit
        import mitsuba  # noqa: F401
    except ImportError as error:
        return str(error)
    return llvm.fault(tuple(drjit.detail.llvm_version())) or ""


class MitsubaWalker:
    """Traces rays against a mesh with Mitsuba.

    Parameters
    ----------
    vertices : (V, 3) R;  faces : (T, 3), counterclockwise seen from outside: closed, inside the unit sphere
    surface : of the grain; its channels are one or as many as mu's
    mu : (C,) 1/R, absorption coefficient of the interior
    events_max : meetings with the surface after which a path is cut

    Notes
    -----
    Positions and directions under way are float32: a place on the surface is good to 1e-7 R, a ray starts 5e-7 R off it, and
    directions that turn by less than `FORWARD` count as unscattered.
    """

    def __init__(self, vertices, faces, surface: Surface, mu, events_max: int = EVENTS_MAX):
        self.vertices, self.faces = np.ascontiguousarray(vertices, np.float64), np.ascontiguousarray(faces, np.int64)
        mu = np.atleast_1d(np.asarray(mu, float))
        self.surface, self.mu = surface, np.array(np.broadcast_to(mu, max(len(mu), surface.channels.shape[1])))
        self.events_max, self._loop = min(int(events_max), (1 << _COUNT) - 1), None

    def trace(self, uniform, first, replicate, key) -> Paths:
        """As `walk.Walker.trace`: rays of `uniform` (n, 4), path i with the stream (first + i, replicate) of the key."""
        import drjit as dr

        paths, rays = Paths.empty(len(uniform), len(self.mu)), _aligned(len(uniform), 8)
        for numbers, start, incoming in zip(uniform, paths.start, paths.incoming, strict=True):
            enter(numbers, start, incoming)
        rays[:, :3], rays[:, 4:7] = paths.start - AHEAD * paths.incoming, paths.incoming
        words = rays.view(np.uint32)
        words[:, 3], words[:, 7] = np.uint32(first) + np.arange(len(uniform), dtype=np.uint32), replicate
        with _variant():
            self._loop = self._loop or _Loop(*_scene(self.vertices, self.faces), self.surface)
            ends, marks, carried = self._loop.launch(float(np.min(self.mu)), self.events_max, rays, key)
            dr.eval(ends, marks, *carried)
            carried = np.stack([c.numpy() for c in carried], axis=-1) if carried else np.ones((len(rays), 1), np.float32)
            _finish(ends.numpy().reshape(-1, 8), marks.numpy(), carried, self, paths)
        return paths


# ---- Mitsuba


def _modules():
    import drjit
    import mitsuba

    return mitsuba, drjit


class _variant:
    """Sets the variant, and puts back the one that somebody else had set."""

    def __enter__(self):
        mi, _ = _modules()
        self.before = mi.variant()
        if self.before != VARIANT:
            mi.set_variant(VARIANT)

    def __exit__(self, *_):
        if self.before not in (None, VARIANT):
            _modules()[0].set_variant(self.before)


def _scene(vertices, faces):
    """Scene of a mesh, and a table (T, 4, 4) of corner, two edges and, in the last column, the normal of each triangle."""
    mi, _ = _modules()
    mesh = mi.Mesh("grain", len(vertices), len(faces))
    values = mi.traverse(mesh)
    values["vertex_positions"] = mi.Float(vertices.astype(np.float32).ravel())
    values["faces"] = mi.UInt32(faces.astype(np.uint32).ravel())
    values.update()
    # robust: without it 1e-6 to 4e-6 of the paths slip through edges, for 15 % less time
    scene = mi.load_dict({"type": "scene", "embree_use_robust_intersections": True, "grain": mesh})
    a, b, c = (vertices.astype(np.float32).astype(float)[faces[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
    table = _aligned(len(faces), 4, 4)
    table[:, 0, :3], table[:, 1, :3], table[:, 2, :3], table[:, :3, 3] = a, b - a, c - a, normal
    table[:, 3] = 0
    return scene, mi.Float(table.ravel())


def _bsdf(surface: Surface):
    """Mitsuba's BSDF of a surface, of reflectance 1: colours are weighed along the path."""
    mi, dr = _modules()
    plugin = {DIELECTRIC: {"type": "dielectric", "int_ior": surface.index, "ext_ior": 1.0},
              DIFFUSE: {"type": "diffuse", "reflectance": 1.0},
              CONDUCTOR: {"type": "conductor", "material": "none"}}[surface.kind]
    if surface.roughness > 0:
        plugin |= {"type": "rough" + plugin["type"], "distribution": "ggx", "sample_visible": True, "alpha": surface.roughness}
    bsdf = mi.load_dict(plugin)
    dr.make_opaque(bsdf)
    return bsdf


@dataclass
class _Path:
    """A lane of the loop: whether it has a path, whether that has ended, its place in the list, the numbers of its random stream,
    its ray, whether that is inside, its way there, meetings, weight, and what it carries in each channel."""

    live: object
    ended: object
    at: object
    number: object
    replicate: object
    o: object
    d: object
    within: object
    path_inside: object
    count: object
    factor: object
    carried: list


class _Loop:
    """The kernel that follows paths.  What differs from call to call is opaque: a literal would be compiled anew."""

    def __init__(self, scene, table, surface):
        mi, _ = _modules()
        self.scene, self.table, self.bsdf, self.surface = scene, table, _bsdf(surface), surface
        self.context = mi.BSDFContext()
        self.context.mode = mi.TransportMode.Importance  # energy: no factor index^2 on refraction

    def launch(self, least, events_max, rays, key):
        """What `MitsubaWalker._run` returns, as arrays of Dr.Jit."""
        mi, dr = _modules()
        self.total, self.events_max = dr.opaque(mi.UInt32, len(rays)), dr.opaque(mi.UInt32, events_max)
        self.key, self.least = dr.opaque(mi.UInt64, int(key[0]) | int(key[1]) << 32), dr.opaque(mi.Float, least)
        self.counter, self.rays = dr.opaque(mi.UInt32, 0), mi.Float(rays.ravel())
        self.metals, self.brightest = [], None
        if self.surface.kind == CONDUCTOR:
            n, k = self.surface.channels
            perfect = np.isinf(n)  # 0 + i reflects all
            self.metals = [mi.Complex2f(dr.opaque(mi.Float, float(a)), dr.opaque(mi.Float, float(b)))
                           for a, b in zip(np.where(perfect, 0.0, n), np.where(perfect, 1.0, k))]
        elif self.surface.kind == DIFFUSE:
            self.brightest = dr.opaque(mi.Float, float(self.surface.channels[0].max()))
        number = dr.width(self.rays) // 8
        self.ends, self.marks = dr.empty(mi.Float, 8 * number), dr.empty(mi.UInt32, number)
        self.weights = [dr.empty(mi.Float, number) for _ in self.metals]
        idle, zero = dr.full(mi.Bool, True, _LANES), mi.UInt32(0)
        channels = [mi.Float(1) for _ in self.metals or [self.brightest] if _ is not None]
        first = _Path(idle, mi.Bool(True), zero, zero, zero, mi.Point3f(0), mi.Vector3f(0, 0, 1), mi.Bool(False), mi.Float(0),
                      zero, mi.Float(1), channels)
        dr.while_loop((first,), lambda path: path.live, lambda path: (self.meeting(path),), mode="symbolic")
        return self.ends, self.marks, self.weights

    def meeting(self, path):
        """One meeting of each path with the surface; lanes whose path has ended take the next one first."""
        mi, dr = _modules()
        path = self._next(path)
        intersection = self.scene.ray_intersect_preliminary(mi.Ray3f(path.o, path.d), coherent=False, active=path.live)
        hit = path.live & (intersection.t < dr.inf)
        a, b, c = (dr.gather(mi.Vector4f, self.table, 4 * intersection.prim_index + k, hit) for k in range(3))
        normal, (u, v) = mi.Normal3f(a.w, b.w, c.w), intersection.prim_uv
        p = dr.fma(v, mi.Point3f(c.x, c.y, c.z), dr.fma(u, mi.Point3f(b.x, b.y, b.z), mi.Point3f(a.x, a.y, a.z)))
        z = -dr.dot(path.d, normal)
        wrong = (hit & (((z < 0) != path.within) | (z == 0))) | (path.live & ~hit & path.within)
        go = hit & ~wrong
        path.path_inside = dr.select(go & path.within, path.path_inside + intersection.t, path.path_inside)
        cut = go & (path.count == self.events_max)
        go = go & ~cut
        path.count = dr.select(go, path.count + 1, path.count)
        go = self._turn(path, p, normal, go)
        path.ended = path.live & ~go
        state = dr.select(hit, dr.select(cut, CUT, ABSORBED), dr.select(path.count > 0, LEFT, MISSED))
        self._record(path, mi.UInt32(dr.select(wrong, CONTRADICTED, state)))
        return path

    def _next(self, path):
        """Lanes whose path has ended take the next one."""
        mi, dr = _modules()
        at = dr.select(path.ended, dr.scatter_inc(self.counter, mi.UInt32(0), path.live & path.ended), path.at)
        live = path.live & (at < self.total)
        new = live & path.ended
        a, b = dr.gather(mi.Vector4f, self.rays, 2 * at, new), dr.gather(mi.Vector4f, self.rays, 2 * at + 1, new)
        o, d = dr.select(new, mi.Point3f(a.x, a.y, a.z), path.o), dr.select(new, mi.Vector3f(b.x, b.y, b.z), path.d)
        number = dr.select(new, dr.reinterpret_array(mi.UInt32, a.w), path.number)
        replicate = dr.select(new, dr.reinterpret_array(mi.UInt32, b.w), path.replicate)
        return _Path(live, path.ended, at, number, replicate, o, d, path.within & ~new, dr.select(new, 0.0, path.path_inside),
                     dr.select(new, 0, path.count), dr.select(new, 1.0, path.factor),
                     [dr.select(new, 1.0, c) for c in path.carried])

    def _turn(self, path, p, normal, go):
        """A new direction from the BSDF, with the random numbers of this meeting; which of the paths `go` on still."""
        mi, dr = _modules()
        u0, u1, u2, u3 = mi.Philox4x32(self.key, path.number, path.replicate, path.count, 10).next_float32x4()
        frame = mi.Frame3f(normal)
        at_surface = dr.zeros(mi.SurfaceInteraction3f)
        at_surface.wi = frame.to_local(-path.d)
        # middles of steps: at 0 a reflectance of 0 would reflect
        sample, weight = self.bsdf.sample(self.context, at_surface, u0 + 2.0**-24, mi.Point2f(u1, u2), go)
        factor, carried = dr.select(go, path.factor * weight.x, path.factor), path.carried
        if self.metals:
            facet = dr.normalize(at_surface.wi + sample.wo)
            cosine = dr.clip(dr.dot(at_surface.wi, facet), 0.0, 1.0)
            carried = [dr.select(go & (factor > 0), c * mi.fresnel_conductor(cosine, metal), c)
                       for c, metal in zip(carried, self.metals)]
        elif self.brightest is not None:
            carried = [dr.select(go, carried[0] * self.brightest, carried[0])]
        # faint paths go on by chance
        strongest = factor * functools.reduce(dr.maximum, carried, mi.Float(0)) if carried else factor
        strongest = strongest * dr.exp(-self.least * path.path_inside)
        faint = go & (strongest < FAINT)
        dead = faint & (u3 * FAINT >= strongest)
        path.factor, path.carried = dr.select(faint & ~dead, factor * (FAINT / strongest), factor), carried
        go = go & ~dead
        inward = sample.wo.z < 0
        path.within = dr.select(go, inward, path.within)
        path.o = dr.select(go, dr.fma(dr.select(inward, -_OFF, _OFF), normal, p), path.o)
        path.d = dr.select(go, dr.normalize(frame.to_world(sample.wo)), path.d)
        return go

    def _record(self, path, state):
        """Write down the paths that have ended."""
        mi, dr = _modules()
        o, d = path.o, path.d
        dr.scatter(self.ends, mi.Vector4f(o.x, o.y, o.z, path.path_inside), 2 * path.at, path.ended)
        dr.scatter(self.ends, mi.Vector4f(d.x, d.y, d.z, path.factor), 2 * path.at + 1, path.ended)
        dr.scatter(self.marks, path.count | (state << _COUNT), path.at, path.ended)
        for target, carried in zip(self.weights, path.carried):
            dr.scatter(target, carried, path.at, path.ended)


# ---- double precision at both ends


def _aligned(*shape):
    """Unset float32 at a multiple of 64 bytes: Dr.Jit compiles other kernels for arrays that are not."""
    size = int(np.prod(shape))
    whole = np.empty(size + 16, np.float32)
    start = -whole.ctypes.data % 64 // 4
    return whole[start : start + size].reshape(shape)


def _finish(ends, marks, carried, walker, paths):
    """Fill `Paths` from ends (n, 8): place, way inside, direction, weight; marks (n,): status, meetings; carried (n, C or 1)."""
    paths.status[:], paths.events[:], paths.inside[:] = marks >> _COUNT, marks & ((1 << _COUNT) - 1), ends[:, 3]
    direction = ends[:, 4:7].astype(float)
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    unchanged = np.linalg.norm(direction - paths.incoming, axis=1, keepdims=True) < FORWARD
    paths.outgoing[:] = np.where(unchanged, paths.incoming, direction)
    missed = paths.status == MISSED
    point = np.where(missed[:, None], paths.start, ends[:, :3])
    along = np.sum(point * paths.outgoing, axis=1)
    t = np.sqrt(along**2 + np.maximum(1.0 - np.sum(point**2, axis=1), 0.0)) - along
    paths.leave[:] = point + t[:, None] * paths.outgoing
    light = ends[:, 7:].astype(float) * np.exp(-np.outer(paths.inside, walker.mu)) * carried
    if walker.surface.kind == DIFFUSE:
        light = ends[:, 7:].astype(float) * walker.surface.channels[0] ** paths.events[:, None]
    lost = np.isin(paths.status, (ABSORBED, CONTRADICTED))
    paths.weight[:] = np.where(missed[:, None], 1.0, np.where(lost[:, None], 0.0, light))
