"""How boundaries of bodies see the lamps of a scene, and which of them are worth light samples."""

import drjit as dr
import numpy as np

from bakery.kernels import stream_key
from renderers.mitsuba.shading import arrays, columns, single
from renderers.transport import wavefront
from renderers.transport.manifold import numbered, refractive_index
from renderers.transport.skies import Sky

import mitsuba as mi  # isort: skip

# sr, times the cosine at the boundary, of lamps that are drawn: paths meet wider ones often enough.  A ball of mean free paths of
# a fifth to a fifteenth of its radius under a panel, variance times time with over without light samples, all light: 0.3 (g 0)
# and 0.7 (0.8) at 0.5 sr, 0.6 and 1.4 at 1.4, 1.1 and 1.5 at 2.4
WIDEST_ALONE = 0.6
# The same where directions are drawn for wider ones (`wide`), and there behind panes, where walks take longer.  Variance times
# time as lamps that are drawn, and as wide ones: flame of 0.34 sr beside a candle 0.076 and 0.091, window of 120 mm over a glass
# of milk 0.141 and 0.122
WIDEST, WIDEST_BEHIND_PANES = 0.4, 0.2
_PLACES, _POINTS = 512, 16  # on the boundaries; on a lamp, seen from each of them
_CROSSED = 8  # panes, and boundaries to which light is blind, on the way, at most
_EVEN = ("Rectangle", "Disk", "Sphere", "Cylinder")  # shapes, besides meshes, on which points are drawn evenly


def drawn(scene, boundaries, panes=(), sky=None, widest=WIDEST_ALONE):
    """How likely each lamp is to be drawn, by shapes of Mitsuba, in proportion to the light that it sends to the boundaries.

    scene : `scene.Scene`;  boundaries : meshes of Mitsuba;  panes : such of smooth glass, through which lamps are seen
    sky : None, or `skies.Sky`, which is drawn where most of its light comes from a small part of it
    widest : sr, times the cosine at the boundary, of lamps that are drawn

    Lamps are left out that no place sees, and those that are wide: their solid angle, averaged over places by itself, tells how
    wide they are where their light comes in.  Ways through panes count as straight.
    """
    position, normal = _positions(boundaries, _numbers(0, _PLACES, 3))
    shares = {}
    for number, shape in enumerate(scene.scene.shapes()):
        if not _is_lamp(shape):
            continue
        angle, radiance, _ = _seen(scene, position, normal, shape, _numbers(1 + number, _PLACES * _POINTS, 2), panes)
        angle = angle.reshape(_PLACES, _POINTS).mean(axis=1)
        if radiance > 0 and 0 < (angle**2).sum() < widest * angle.sum():
            shares[shape] = float(angle.mean() * radiance)
    if sky:
        width, light = _width(scene, position, normal, sky, _numbers(0, _PLACES * _POINTS, 2), panes)
        if 0 < width < widest:
            shares[sky] = light
    return {shape: share / sum(shares.values()) for shape, share in shares.items()}


def _width(scene, position, normal, sky, numbers, panes):
    """Solid angle (sr) that a light all around would have that were as bright as its light is on average, times the cosine; and
    the light that comes to places, for each by one direction, by numbers (n, 2)."""
    light, radiance, _ = _from_sky(scene, position, normal, sky, numbers, panes)
    whole, square = float(light.mean()), float((light * radiance).mean())
    return (whole**2 / square if square > 0 else 0.0), whole


def _from_sky(scene, position, normal, sky, numbers, panes):
    """Light (n,) that comes to places from a light all around, for each by one direction; its radiance (n,); and the indices (n,)
    around the places over 1, that around the sky."""
    point, normal = (kind(*map(single, rows)) for kind, rows in ((mi.Point3f, position), (mi.Normal3f, normal)))
    target = sky.drawn(point, mi.Point2f(*columns(numbers)), True)
    towards, density = dr.normalize(target - point), sky.solid_density(point, target)
    cosine, radiance = dr.dot(normal, towards), dr.mean(sky.radiance(towards, True))
    active, ratio = _passes(scene, point, normal, target, cosine > 0, panes)
    light = dr.select(active & (density > 0), cosine * radiance / density, 0)
    return tuple(values.astype(float) for values in arrays(len(numbers), light, radiance, ratio))


def index_around(scene, boundary, panes, lamps):
    """Refractive index around a body over that around lamps, the median over straight ways to them; 1 where there are none.

    scene : `scene.Scene`;  boundary : mesh of Mitsuba, the body's;  panes : as of `drawn`;  lamps : shapes, or a `skies.Sky`
    """
    position, normal = _positions([boundary], _numbers(0, _PLACES, 3))
    ratios = [np.empty(0)]
    for lamp in lamps:
        seen = _from_sky if isinstance(lamp, Sky) else _seen
        light, _, ratio = seen(scene, position, normal, lamp, _numbers(1, _PLACES * _POINTS, 2), panes)
        ratios.append(ratio[light > 0])
    ratios = np.concatenate(ratios)
    return float(np.quantile(ratios, 0.5, method="nearest")) if len(ratios) else 1.0


def _is_lamp(shape):
    return shape.is_emitter() and shape.emitter().class_name() == "AreaLight" \
        and (shape.is_mesh() or shape.class_name() in _EVEN)


def _numbers(number, count, width):
    """Uniform random numbers (count, width): those of a lamp by its number from 1, of places by 0; alike in all renders."""
    return wavefront.uniforms(wavefront.streams(stream_key(0, "render.solid_angles", number), count), width)


def _positions(boundaries, numbers):
    """Places and normals (3, n), each `_POINTS` times, evenly on meshes, by numbers (n, 3)."""
    corners = np.concatenate([np.array(mesh.vertex_positions_buffer(), float).reshape(-1, 3)[
        np.array(mesh.faces_buffer(), np.int64).reshape(-1, 3)] for mesh in boundaries])
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(normals, axis=1)
    faces = np.minimum(np.searchsorted(np.cumsum(area), numbers[:, 0] * area.sum(), side="right"), len(area) - 1)
    root = np.sqrt(numbers[:, 1])
    weights = np.stack([1 - root, root * (1 - numbers[:, 2]), root * numbers[:, 2]], axis=1)
    positions = np.einsum("nk,nkc->nc", weights, corners[faces])
    return [np.repeat(rows, _POINTS, axis=0).T for rows in (positions, normals[faces] / area[faces, None])]


def _seen(scene, position, normal, lamp, numbers, panes=()):
    """Solid angles (n,) sr of a lamp, times the cosine, from places, each by one point on it; its mean radiance there; and the
    indices (n,) around the places over those around the lamp.

    numbers : (n, 2), of the points
    """
    position, normal = (kind(*map(single, rows)) for kind, rows in ((mi.Point3f, position), (mi.Vector3f, normal)))
    point = lamp.sample_position(0.0, mi.Point2f(*columns(numbers)))
    distance, toward = dr.norm(point.p - position), dr.normalize(point.p - position)
    angle = dr.maximum(dr.dot(normal, toward), 0) * dr.maximum(-dr.dot(point.n, toward), 0) / (point.pdf * dr.square(distance))
    surface = mi.SurfaceInteraction3f(point, dr.zeros(mi.Color0f))
    surface.wi = surface.to_local(-toward)
    radiance = dr.mean(lamp.emitter().eval(surface, angle > 0))
    active, ratio = _passes(scene, position, normal, point.p, angle > 0, panes)
    angle, radiance, ratio = arrays(len(numbers), dr.select(active, angle, 0), radiance, ratio)
    angle = angle.astype(float)
    return angle, float((angle * radiance).sum() / max(angle.sum(), 1e-30)), ratio


def _passes(scene, position, normal, target, active, panes):
    """Whether nothing hides targets from places, and the indices around the places over those around the targets."""
    index = numbered(scene.scene, panes, [refractive_index(pane) for pane in panes], np.float32)
    ray = mi.Interaction3f(0.0, 0.0, dr.zeros(mi.Color0f), position, normal).spawn_ray_to(target)
    active, ratio = mi.Bool(active), mi.Float(1)
    for _ in range(_CROSSED):
        hit = scene.scene.ray_intersect_preliminary(ray, coherent=False, active=active)
        of_pane = dr.gather(mi.Float, index, dr.reinterpret_array(mi.UInt32, hit.shape))
        crosses = active & hit.is_valid() & (scene.boundaries.is_blind(hit.shape) | (of_pane > 0))
        active &= ~hit.is_valid() | crosses
        crossed = hit.compute_surface_interaction(ray, mi.RayFlags.Minimal, crosses)
        ratio *= dr.select(crosses & (of_pane > 0), dr.select(dr.dot(crossed.n, ray.d) > 0, of_pane, dr.rcp(of_pane)), 1)
        across = scene.boundaries.across(crossed, ray.d)
        ray.o, ray.maxt = dr.select(crosses, across, ray.o), dr.select(crosses, ray.maxt - hit.t, ray.maxt)
    return active, ratio
