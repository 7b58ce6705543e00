"""Light of many events is smooth over a boundary: pixels that see the same stretch of it share what they have gathered.

Each takes the value at its own place of a plane fitted to the pixels around (local linear regression), so what is lost is only
how the light bends within a fraction of a transport mean free path; half the distance tells how much that is.
"""

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

# over which light is taken to be linear: transport mean free paths, and mean chords of the body.  Balls of half a mean free path,
# g 0.8, in 32 pixels: three and more events too dark by 17 % without the second, by 0.6 % with it.
_REACH, _THIN = 0.5, 0.1
_MOST = 8  # pixels
_FACING = 0.8  # cosine between normals, at least, of places that share
_BLOCK, _STEP = 2, 3  # pixels a side, of those of which one gathers; from its place in one pass to that in the next
_PANES = 6  # sides of glass through which bodies are seen
_CLOSE = 0.4  # of the distance over which pixels share: still near enough where half of it is taken


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


def reduced(medium):
    """sigma_t' (L,) 1/m: of each wavelength the extinction, but for light that goes on as it came."""
    return medium.sigma_t * (1 - medium.albedo * mean_cosines(medium))


def smoothed(image, gathers, view, share=1.0):
    """An image (H, W, 3) where pixels that see a body share with those around; `share` of the distance.

    gathers : (H, W) bool, pixels that have a value: all, or those that are `chosen`
    """
    out = np.empty(image.shape)
    run(_fit, len(image), np.ascontiguousarray(image, float), gathers, view, float(share), out, block=8)
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def _fit(image, gathers, view, share, out, begin, end):
    body, point, normal, reach = lent(view)
    height, width = body.shape
    across = share * share * (_MOST + 1.0) ** 2
    most = min(int(share * (_MOST + 1.0)), _MOST)  # pixels, beyond which none counts
    for y in range(begin, end):
        for x in range(width):
            for c in range(3):
                out[y, x, c] = image[y, x, c]
            if body[y, x] < 0:
                continue
            limit = share * reach[y, x]
            m00 = m01 = m02 = m11 = m12 = m22 = 0.0
            s0, s1, s2 = np.zeros(3), np.zeros(3), np.zeros(3)
            for j in range(max(y - most, 0), min(y + most + 1, height)):
                for i in range(max(x - most, 0), min(x + most + 1, width)):
                    u, v = i - x, j - y
                    if not gathers[j, i] or body[j, i] != body[y, x] or u * u + v * v >= across:
                        continue
                    facing, square = 0.0, 0.0
                    for k in range(3):
                        facing += normal[y, x, k] * normal[j, i, k]
                        square += (point[y, x, k] - point[j, i, k]) ** 2
                    # both a distance on the body and one in the picture end what is shared
                    w = 1.0 - max(square / (limit * limit), (u * u + v * v) / across)
                    if facing < _FACING or not w > 0.0:
                        continue
                    m00 += w
                    m01 += w * u
                    m02 += w * v
                    m11 += w * u * u
                    m12 += w * u * v
                    m22 += w * v * v
                    for c in range(3):
                        value = w * image[j, i, c]
                        s0[c] += value
                        s1[c] += value * u
                        s2[c] += value * v
            # the first row of the inverse of the moments
            a, b, c_ = m11 * m22 - m12 * m12, m02 * m12 - m01 * m22, m01 * m12 - m02 * m11
            whole = m00 * a + m01 * b + m02 * c_
            # no plane where its noise would be more than that of one pixel, as beyond few pixels to one side
            flat = not (whole > 1e-6 * m00 * m11 * m22 and a <= whole)
            for c in range(3):
                out[y, x, c] = s0[c] / m00 if flat else (a * s0[c] + b * s1[c] + c_ * s2[c]) / whole
