"""Light of many events is smooth over a boundary: pixels that see the same stretch of it share what they have gathered.

Each takes the value at its own place of a polynomial of degree two fitted to the pixels around (local quadratic regression:
Fan and Gijbels 1996), so what is lost is only how light bends otherwise within a transport mean free path; half the distance
tells how much that is.
"""

import math
from typing import NamedTuple

import numpy as np

from bakery.kernels import lent
from bakery.system.compiled import njit
from renderers.materials.bodies import _geometry
from renderers.materials.bodies.surfaces import located
from renderers.mitsuba.shading import LOBE
from renderers.threads import run
from renderers.transport.scattering import mean_cosines
from renderers.transport.solids import chord

# over which light is taken to be a polynomial: transport mean free paths, and mean chords of the body.  Balls of half a mean free
# path, g 0.8, in 32 pixels: three and more events too dark by 17 % by planes without the second.
_REACH, _THIN = 0.7, 0.14
_MOST = 11  # pixels
_TERMS = 6  # of the polynomial
_SINGULAR = 1e-6  # of a moment, that is left when those of other terms have been taken away: beneath it they tell nothing apart
_FACING = 0.95  # cosine between normals, at least, of places that share
_BLOCK, _STEP = 2, 3  # pixels a side, of those of which one gathers; from its place in one pass to that in the next
_PANES = 6  # sides of glass through which bodies are seen
# Lines of sight of a pixel from which on it shares over less, so that what is lost vanishes as the noise does; those of methods
# with few beams a line, whose variance is ten times as large.  With one of four pixels gathering half is the least.  What is lost
# goes with the distance to the power 2.7 (wax, bumpy ball), and noise and loss together are least where it falls so.
FULL, FULL_OF_FEW = 32, 320
_NOISIER = 1.2  # power of the inverse of the distance with which variance grows: neighbours share noise, too (wax, bumpy ball)
_FALLS, _LEAST = 1 / 8, 0.5
_CLOSE = 0.25  # of the distance over which pixels share: still near enough where half of it is taken


class Seen(NamedTuple):
    """What pixels see.

    body : (H, W) of the boundary, or -1;  point, normal : (H, W, 3) m, unit;  reach : (H, W) m, over which pixels share
    """

    body: np.ndarray
    point: np.ndarray
    normal: np.ndarray
    reach: np.ndarray


def seen(transport, rays) -> Seen:
    """Boundaries of bodies that one camera ray a pixel meets, with nothing in between but smooth panes of glass.

    rays : `Paths` of all pixels from the camera, in their order
    """
    height, width = transport.world.size
    body, point, normal = np.full(rays.count, -1), rays.origin.copy(), np.zeros((rays.count, 3))
    for _ in range(_PANES):
        located(transport.geometry, rays)
        owner = np.where(rays.triangle >= 0, transport.geometry.owner[rays.triangle], -1)
        free = ~(transport.world.trace(rays.origin, rays.direction, rays.far * (1 - 1e-4)) < np.inf)
        owned, at = (owner >= 0) & free, rays.pixel
        body[at[owned]], point[at[owned]] = owner[owned], rays.origin[owned] + rays.far[owned, None] * rays.direction[owned]
        facing = np.zeros((rays.count, 3))
        run(_geometry.normals, rays.count, transport.geometry, rays.triangle, facing)
        normal[at[owned]] = facing[owned]
        if not transport.panes or free.all():
            break
        rays = _beyond_glass(transport.world, rays.of(~free))
    reach = np.array([min(_REACH / np.min(reduced(solid.medium)), _THIN * chord(solid.vertices, solid.faces))
                      for solid in transport.bodies])
    return Seen(body.reshape(height, width), point.reshape(height, width, 3), normal.reshape(height, width, 3),
                np.where(body >= 0, reach[body], 0.0).reshape(height, width))


def _beyond_glass(world, rays):
    """Rays that go on through smooth glass, as it refracts them."""
    numbers = np.zeros((rays.count, LOBE + 3))
    numbers[:, LOBE] = 1.0
    shading = world.shade(rays.origin, rays.direction, numbers, rays.density, rays.single)
    towards = shading.direction.astype(float)
    goes = shading.hit & shading.delta & (shading.density > 0) & (np.einsum("nk,nk->n", towards, rays.direction) > 0)
    rays.origin[:], rays.direction[:], rays.start[:] = shading.origin, towards, -1
    return rays.of(goes)


def sharing(view, gathers, bodies) -> np.ndarray:
    """How many values share pixels (bodies,), by their weights: median of those that see each body, at least 1.

    gathers : (H, W) bool, pixels that have a value
    """
    alike = view.body[:, 1:] == view.body[:, :-1]
    apart = np.linalg.norm(view.point[:, 1:] - view.point[:, :-1], axis=2)
    pixels = np.minimum(view.reach[:, 1:] / np.maximum(apart, 1e-300), _MOST + 1)
    # (sum w)^2 / sum w^2 of w = 1 - (r/R)^2
    return np.array([max(0.75 * np.pi * np.median(pixels[pairs]) ** 2 * gathers[view.body == body].mean(), 1.0)
                     if (pairs := alike & (view.body[:, 1:] == body)).any() else 1.0 for body in range(bodies)])


def chosen(view, number) -> np.ndarray:
    """Pixels (H, W) that gather in pass `number`, bool: one of each block that is small beside what is shared, another in each
    pass; elsewhere all."""
    height, width = (side // _BLOCK for side in view.body.shape)
    y, x = divmod(_STEP * number % _BLOCK**2, _BLOCK)

    def blocks(values):
        kept = values[:height * _BLOCK, :width * _BLOCK]
        return kept.reshape(height, _BLOCK, width, _BLOCK, *values.shape[2:])

    def middle(values):
        return blocks(values)[:, y:y + 1, :, x:x + 1]

    alike = (blocks(view.body) == middle(view.body)) & (middle(view.body) >= 0)
    alike &= np.linalg.norm(blocks(view.point) - middle(view.point), axis=-1) < _CLOSE * middle(view.reach)
    alike &= np.sum(blocks(view.normal) * middle(view.normal), axis=-1) > _FACING
    gathers = np.ones(view.body.shape, bool)
    spare = blocks(gathers)
    spare &= ~alike.all(axis=(1, 3), keepdims=True)
    spare[:, y, :, x] = True
    return gathers


def falling(lines, spares, full):
    """Share of the distance over which pixels share in a pass.

    lines : of sight of a pixel, with those of the passes before;  spares : whether some pixels have none
    full : lines from which on it falls, `FULL` or `FULL_OF_FEW`
    """
    share = min(1.0, (full / lines) ** _FALLS)
    return max(share, _LEAST) if spares else share


def noisier(passes, lines, full, spares=False):
    """Variance of the last of so many passes, of so many lines each, over that of one that shares over the whole distance;
    parameters as those of `falling`."""
    return falling(lines * passes, spares, full) ** -_NOISIER


def reduced(medium):
    """sigma_t' (L,) 1/m: of each wavelength the extinction, but for light that goes on as it came."""
    return medium.sigma_t * (1 - medium.albedo * mean_cosines(medium))


def smoothed(image, gathers, view, share=1.0, cover=None):
    """An image (H, W, 3) where pixels that see a body share with those around; `share` of the distance.

    gathers : (H, W) bool, pixels that have a value: all, or those that are `chosen`
    cover : (H, W) how much of each pixel is a body that light can come from: what is smooth is the image over that; None: alike
    """
    out = np.empty(image.shape)
    cover = np.ones(gathers.shape) if cover is None else np.ascontiguousarray(cover / max(cover.max(), 1e-300), float)
    run(_fit, len(image), np.ascontiguousarray(image, float), gathers, view, float(share), cover, out, block=8)
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def _fit(image, gathers, view, share, cover, out, begin, end):
    body, (height, width), most = lent(view).body, gathers.shape, min(int(share * (_MOST + 1.0)), _MOST)
    terms, moments, values = np.empty(_TERMS), np.empty((_TERMS, _TERMS)), np.empty((_TERMS, 3))
    root, row = np.empty((_TERMS, _TERMS)), np.empty(_TERMS)
    terms[0] = 1.0
    for y in range(begin, end):
        for x in range(width):
            out[y, x] = image[y, x]
            if body[y, x] < 0 or not cover[y, x] > 0.0:
                continue
            moments[:], values[:] = 0.0, 0.0
            for j in range(max(y - most, 0), min(y + most + 1, height)):
                for i in range(max(x - most, 0), min(x + most + 1, width)):
                    w = _weight(view, share, (x, y), (i, j)) if gathers[j, i] and body[j, i] == body[y, x] else 0.0
                    if not w * cover[j, i] > 0.0:
                        continue
                    u, v = float(i - x), float(j - y)
                    terms[1], terms[2], terms[3], terms[4], terms[5] = u, v, u * u, u * v, v * v
                    for a in range(_TERMS):
                        for b in range(a + 1):
                            moments[a, b] += w * cover[j, i] * terms[a] * terms[b]
                        for c in range(3):
                            values[a, c] += w * terms[a] * image[j, i, c]
            # a plane or a mean where the noise would be more than that of one pixel, as beyond few pixels to one side
            count = _TERMS if _inverted(moments, _TERMS, cover[y, x], root, row) else 3 \
                if _inverted(moments, 3, cover[y, x], root, row) else 1
            row[0] = row[0] if count > 1 else 1 / moments[0, 0]
            for c in range(3 if moments[0, 0] > 0.0 else 0):
                out[y, x, c] = cover[y, x] * (row[:count] * values[:count, c]).sum()


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _weight(view, share, pixel, neighbour):
    """What a pixel (x, y) counts for another, 0 to 1: both a distance on the body and one in the picture end what is shared."""
    (x, y), (i, j), facing, square = pixel, neighbour, 0.0, 0.0
    limit, across = share * view.reach[y, x], share * (_MOST + 1.0)
    for k in range(3):
        facing += view.normal[y, x, k] * view.normal[j, i, k]
        square += (view.point[y, x, k] - view.point[j, i, k]) ** 2
    w = 1.0 - max(square / (limit * limit), ((i - x) ** 2 + (j - y) ** 2) / (across * across))
    return w if facing > _FACING and w > 0.0 else 0.0


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _inverted(moments, count, cover, root, row):
    """Whether so many terms can be fitted, with no more noise than that of one pixel; makes row (count,) the first of the
    inverse of the moments, by Cholesky's root."""
    for a in range(count):
        for b in range(a + 1):
            pivot = moments[a, b]
            for k in range(b):
                pivot -= root[a, k] * root[b, k]
            if a > b:
                root[a, b] = pivot / root[b, b]
            elif not pivot > _SINGULAR * moments[a, a]:
                return False
            else:
                root[a, a] = math.sqrt(pivot)
    for a in range(count):
        row[a] = 1.0 if a == 0 else 0.0
        for k in range(a):
            row[a] -= root[a, k] * row[k]
        row[a] /= root[a, a]
    for a in range(count - 1, -1, -1):
        for k in range(a + 1, count):
            row[a] -= root[k, a] * row[k]
        row[a] /= root[a, a]
    return cover * row[0] <= 1.0
