"""How far off a body's picture is by its surface alone: how far light spreads under it, over pixels and over its radius.

Light leaves a surface where it came in.  In the body it leaves some way off, which shows where the light that comes in changes:
where the boundary bends away from it, and at the edges of shadows.
"""

import math
from typing import NamedTuple

import numpy as np

from bakery import kernels
from renderers import colour
from renderers.transport import solids

# Root mean square error of regions over the spread of light over the radius of a ball, over the mean: 0.55, 0.27 to 0.45 and 0.22
# at albedo 0.9, 0.99 and 0.999 (docs/surface.md)
OFF = 0.55
_MOST_PATHS = 1e4  # mean free paths, beyond which light that nothing absorbs counts as lost
_BALL = 4 / 3  # mean chord of a ball, over its radius
_EDGES = 4.0  # of n pixels roots of n that the outline of a square crosses
_UNSEEN = 3.0  # pixels of those that are looked at, which edges may cross though none was met there: 5 % odds of more
_LIGHTS = 32  # samples of light that each of them is looked at by
_ABOVE = 1e-4  # of the distance to the camera, by which places stand before the body
_RAYS = 64**2  # of the camera, that tell how wide pixels are
_RADII = np.logspace(-4, 6, 600)  # transport mean free paths


class Seen(NamedTuple):
    """width : (N,) m, of pixels at places that the camera sees of a body
    steps : (N,) squares of what the light changes by over a pixel, to the right and downwards, over its mean on the body
    angle : rad, of a pixel: its width over the distance
    """

    width: np.ndarray
    steps: np.ndarray
    angle: float


# ---- how far light spreads


def spread(asset, layer: int = 0) -> np.ndarray:
    """How far from where it came in light leaves an asset's layer, (L,) m: root mean square, as baked, or else by diffusion.

    Counted among grains, and of former versions, assets hold none.  Of a point of light under the surface, a transport mean free
    path l' deep, and its image above it, at 2 l' of the boundary's own (index 1):
    <r^2> = 2 (z0 e^(-k z0) + z1 e^(-k z1)) / k / (e^(-k z0) + e^(-k z1)), z0 = l', z1 = 7/3 l'.  k is that of diffusion, and no
    less than pi over the thickness; without absorption and thickness it would have no end.
    Source: moments of Farrell, Patterson & Wilson, Med. Phys. 19, 879 (1992).
    """
    if baked(asset):
        return 1e-6 * np.sqrt(np.asarray(asset.surface["mean_square"], float)[:, layer])
    near, far, k = _diffusion(asset, layer)
    share, share_far = np.exp(-k * near), np.exp(-k * far)
    total = np.maximum(share + share_far, 1e-300)
    return np.where(share > 0, np.sqrt(2 * (near * share + far * share_far) / total / k), near)


def mean_distance(asset, layer: int = 0) -> np.ndarray:
    """The same, (L,) m: the mean distance, which few paths that go far hardly change; of baked bins their middle.

    Of the same two points z0, z1: light that leaves at r goes with z (1 + k d) e^(-k d) / d^3, d^2 = r^2 + z^2.
    """
    if baked(asset):
        edges = 1e-6 * np.asarray(asset.surface["spread_radius"], float)[:, layer]
        light = np.asarray(asset.surface["spread"], float)[:, layer].mean(axis=1).sum(axis=1)
        middle = (edges + np.pad(edges[:, :-1], ((0, 0), (1, 0)))) / 2
        return (light * middle).sum(axis=1) / np.maximum(light.sum(axis=1), 1e-300)
    near, far, k = (value[:, None] for value in _diffusion(asset, layer))
    radius = near * _RADII
    leaving = np.zeros_like(radius)
    for depth in (near, far):
        distance = np.hypot(radius, depth)
        leaving += depth * (1 + k * distance) * np.exp(-k * distance) / distance**3
    ring = leaving * radius**2  # of equal steps of the logarithm
    total = ring.sum(axis=1)
    return np.where(total > 0, (ring * radius).sum(axis=1) / np.maximum(total, 1e-300), near[:, 0])


def baked(asset) -> bool:
    """Whether an asset has the spread by walks."""
    return "mean_square" in asset.surface


def _diffusion(asset, layer):
    """Depths of a point of light and of its image, m, and the rate of decay, 1/m, (L,) each."""
    medium = asset.medium
    sigma_t, albedo, g = (np.asarray(medium[name], float) for name in ("sigma_t", "albedo", "g"))
    reduced = np.maximum(sigma_t * (1 - albedo * g), 1e-30)
    absorbed = np.maximum(sigma_t * (1 - albedo), reduced / _MOST_PATHS**2)
    k = np.sqrt(3 * absorbed * reduced)
    thickness = asset.surface.get("thickness")
    if thickness is not None:
        k = np.maximum(k, np.pi / np.maximum(1e-6 * thickness[layer], 1e-30))
    return 1 / reduced, 7 / 3 / reduced, k


# ---- how far off that is


def deviation(scene, number, asset, world) -> float:
    """Expected error of a body by its surface alone, root mean square over its light and wavelengths, at most 1.

    A ball is off by `OFF` times the spread over its radius: of a mesh the radii go by the angles between its triangles, and a
    body is no larger than the ball of its mean chord.  The edge of a shadow moves light by the mean distance m over pi, of
    pixels wider than that, w, by m / (pi w) of their light; of narrower ones the square is m / (4 w), over as many pixels.
    Which pixels edges cross, and how much light changes there, rays tell (`_stepped`).
    """
    entry = scene.values.materials[number]
    (shape,) = (shape for shape in world.shapes() if shape.name == entry.where.shape)
    far, mean, seen = spread(asset, entry.layer or 0), mean_distance(asset, entry.layer or 0), seen_by(world, shape)
    return min(1.0, math.sqrt(float(np.mean(bent(shape, far) ** 2 + at_edges(mean, seen)))))


def at_edges(mean, seen: Seen, weight=1.0) -> np.ndarray:
    """Mean square error (L,) of pixels that edges cross, as `deviation` says; mean : (L,) m;  weight : (N,) of their squares"""
    shares = mean[:, None] / np.maximum(seen.width, 1e-30)
    square = np.minimum((shares / math.pi) ** 2, shares / 4) * weight
    return (square * (seen.steps + min(1.0, _UNSEEN / len(seen.steps)))).mean(axis=1)


def unfit(entry, asset, world) -> str:
    """Why an asset's surface does not stand for what fills the shape of an entry; "" where it does.

    A shape that no light gets into has nothing in it: its surface is all that there is.
    """
    if "surface" not in asset.stages:
        return "no surface is baked"
    named = [shape for shape in world.shapes() if shape.name == entry.where.shape]
    if len(named) != 1:
        return f"there are {len(named)} shapes of the id {entry.where.shape}"
    shape = named[0]
    if shape.index is None:
        return ""
    index, rough = (float(np.asarray(asset.surface[name]).ravel()[0]) for name in ("index", "roughness"))
    if asset.surface.get("thickness") is not None:
        return "its surface is that of a layer, and the shape is full"
    if abs(shape.index - index) > 1e-3 * index:
        return f"its surface is baked under a boundary of index {index:g}, and the shape's has {shape.index:g}"
    if index != 1 and shape.smooth != (rough == 0):
        return "of its surface and of the shape one boundary is rough and one is smooth"
    return ""


def bent(shape, far) -> np.ndarray:
    """Error by which the boundary of a `renderers.mitsuba.shapes.Shape` bends, where light spreads as far as `far` (L,) m."""
    if shape.faces is None:
        size = np.ptp(shape.box, axis=0)
        return OFF * far / max(float(size[size > 0].min(initial=np.inf)) / 2, 1e-30)
    try:
        inside = _BALL / solids.chord(*kernels.solid(shape.vertices, shape.faces))
    except ValueError:
        inside = 0.0  # an open one is a layer, however thick
    return OFF * np.maximum(far * inside, _between_triangles(shape, far))


def _between_triangles(shape, far):
    """Root mean square of the angle, rad, by which a mesh turns over distances (L,): of triangles that are wider than these as
    many as their edges reach."""
    import trimesh

    mesh = trimesh.Trimesh(shape.vertices, shape.faces, process=True)
    if not len(mesh.face_adjacency):
        return np.zeros(len(far))
    apart = np.linalg.norm(np.diff(mesh.triangles_center[mesh.face_adjacency], axis=1)[:, 0], axis=1)
    area = mesh.area_faces[mesh.face_adjacency].sum(axis=1)
    steps = far[:, None] / np.maximum(apart, 1e-30)
    square = mesh.face_adjacency_angles**2 * np.minimum(steps, steps**2)
    return np.sqrt((area * square).sum(axis=1) / max(float(area.sum()), 1e-300))


def seen_by(world, shape) -> Seen:
    """How wide pixels are at a shape, as the camera sees it first; of one that it does not, at the nearest of its box."""
    return seen(world, shape.box, lambda origin, direction: world.first_shape(origin, direction, shape.name))


def seen(world, box, first) -> Seen:
    """The same of what is in a box (2, 3) m; first : of origins and directions of rays, (n, 3) each -> (n,) distances, and
    whether they meet it first"""
    height, width = world.size
    shrink = min(1.0, math.sqrt(_RAYS / (height * width)))
    rows, columns = max(2, round(shrink * height)), max(2, round(shrink * width))
    row, column = ((np.arange(count) + 0.5) / count for count in (rows, columns))
    at = np.stack(np.meshgrid(column * width, row * height), axis=-1).reshape(-1, 2)
    places = [_places(world, at + step, first) for step in ((0, 0), (1, 0), (0, 1))]
    (_, distance, meets), angle = places[0], world.camera.pixel
    if not meets.any():
        nearest = np.clip(world.camera.origin, *box) - world.camera.origin
        return Seen(np.array([angle * float(np.linalg.norm(nearest))]), np.zeros(1), angle)
    pairs = [(point[meets], its[meets]) for point, _, its in places]
    steps = _stepped(world, pairs, first, height * width * meets.mean())
    return Seen(angle * distance[meets], steps, angle)


def _places(world, pixel, first):
    """Of rays through places of the film (n, 2) pixels: where they meet the body (n, 3) m, at what distances, and whether."""
    direction = world.camera.rays_at(pixel % 1, pixel // 1)[1]
    origin = np.full(direction.shape, world.camera.origin)
    distance, meets = first(origin, direction)
    return origin + np.where(meets, (1 - _ABOVE) * distance, 0.0)[:, None] * direction, distance, meets


def _stepped(world, places, first, pixels: float) -> np.ndarray:
    """Squares (N,) of what the light on places changes by to those a pixel beside and below, over the mean of all.

    Where the body ends, or something stands before it, all of the light does.  Light is what lamps and sky send that nothing
    hides, at the angle to the plane through the three places: the same samples of light for all, so that shadows alone tell them
    apart.  Where none comes straight, so many pixels have the edges of a square.
    """
    (middle, _), *beside = places
    across = np.cross(*(np.where(meets[:, None], point - middle, axis)
                        for (point, meets), axis in zip(beside, np.eye(3)[:2], strict=True)))
    normal = across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-300)
    irradiance, *others = [_irradiance(world, point, normal, first) for point, _ in places]
    mean = float(irradiance.mean())
    if not mean > 0:  # what comes by way of others is not looked at
        return np.full(len(middle), min(1.0, _EDGES / math.sqrt(pixels)))
    ends = np.square(irradiance / mean)
    changes = [np.square((another - irradiance) / mean) for another in others]
    return sum(np.where(meets, change, ends) for (_, meets), change in zip(beside, changes, strict=True))


def _irradiance(world, point, normal, first) -> np.ndarray:
    """Luminance (n,) of the light that comes to places straight from lamps and sky."""
    index = np.arange(_LIGHTS)
    lattice = np.stack([(index + 0.5) / _LIGHTS, index * (math.sqrt(5) - 1) / 2 % 1], axis=1)  # Fibonacci's
    at = np.repeat(point, _LIGHTS, axis=0)
    sample = world.lights(at, np.tile(lattice, (len(point), 1)))
    light = (sample.radiance @ colour.LUMINANCE) * np.abs((sample.direction * np.repeat(normal, _LIGHTS, axis=0)).sum(axis=1))
    shines = np.flatnonzero(light)
    if len(shines):
        distance, _ = first(at[shines], np.asarray(sample.direction[shines], float))
        light[shines[distance < sample.distance[shines]]] = 0  # by a body of grains, which is no shape of Mitsuba's
    return light.reshape(-1, _LIGHTS).mean(axis=1)
