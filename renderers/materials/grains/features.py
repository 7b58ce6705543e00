"""What the camera sees of grains, whatever the light: which way their surfaces are turned, and how far they are."""

import numpy as np

from renderers.mitsuba import variants
from renderers.pictures.denoise import Features
from renderers.transport import features, regions
from renderers.transport.scattering import of_asset

_PLACES = np.array([[0.25, 0.25], [0.75, 0.25], [0.25, 0.75], [0.75, 0.75]])  # in a pixel, row and column
_OF_DRAFTS = np.array([[0.5, 0.5]])  # a quarter of the rays, and edges between grains as rough as the picture's own
_NARROW, _WIDE = 1.0, 4.0  # pixels: grains of less width are seen as their mean;  of more each by itself


def places_for(quality) -> np.ndarray:
    """(n, 2) where in a pixel its grains are looked at, row and column."""
    return _OF_DRAFTS if quality == "draft" else _PLACES


def first_hits(world, scene, assets, meshes, seed, quality=None, seen=None) -> Features:
    """Of the grain that each ray meets first, or of the mesh, where a medium stands for the grains from the beginning.

    world : `renderers.mitsuba.world.World`
    scene : `renderers.materials.grains.transport.Transport`
    assets, meshes : of its bodies
    seed : of the surfaces around
    quality : of the picture
    seen : of each body a function as `renderers.materials.grains.paths.seen_grain` without the grains; the interactors' if None

    Grains have the albedo of a meeting with one of their body, and are seen along straight rays: behind glass it is the medium
    which stands for them that counts, and that has no normals.  Pixels show detail where grains are wider than they are, all
    of it where they are four times as wide.
    """
    media = [regions.Medium(regions.Mesh(*mesh), of_asset(asset)) for asset, mesh in zip(assets, meshes)]
    # a graphics card traces rays through one scene at a time, and each mesh is one (`regions.boundary`): there what stands behind
    # the medium is seen in its place
    around = features.first_hits(world, [] if variants.on_gpu(world.variant) else media, scene.colours, seed)
    seen = seen or [scene.interactor(body, scene.technique).seen for body in range(len(scene.bodies))]
    bodies = [with_radius(of_body, filled.radius) for of_body, filled in zip(seen, scene.bodies, strict=True)]
    return of_grains(world, bodies, albedos(media, scene.colours), around, places_for(quality))


def with_radius(seen, radius):
    """What `of_grains` takes of a body.

    seen : as `renderers.materials.grains.paths.seen_grain` without the grains;  radius : m, of the largest of them
    """
    return lambda origin, direction, far: (*seen(origin, direction, far), np.full(len(origin), radius))


def of_grains(world, bodies, albedo, around, at=_PLACES) -> Features:
    """Of grains, where a ray meets any, else of what is around them.

    world : `renderers.mitsuba.world.World`
    bodies : functions of rays' origin, direction and far (n,) m, each of which gives the distance (n,) m to the first grain
        before that or inf, its normal (n, 3), and the radius (n,) m of such grains
    albedo : (bodies, 3)
    around : `Features` without grains
    at : as `places_for` gives them
    """
    seen = [_at(world, bodies, offset) for offset in at]
    share = np.mean([body >= 0 for body, *_ in seen], axis=0)
    colours = np.mean([np.where((body >= 0)[..., None], albedo[body], 0) for body, *_ in seen], axis=0)
    normal = np.mean([normal for _, normal, *_ in seen], axis=0)
    distance = np.quantile([distance for _, _, distance, _ in seen], 0.5, axis=0, method="lower")
    without_grains = (1 - share)[..., None]
    angle, grain = world.camera.angle(*world.size), np.max([radius for *_, radius in seen], axis=0)
    widths = [2 * radius / (angle * distance) for *_, distance, radius in seen]
    detail = np.mean([np.clip((width - _NARROW) / (_WIDE - _NARROW), 0, 1) for width in widths], axis=0)
    return Features(colours + without_grains * around.albedo, normal + without_grains * around.normal,
                    np.where(np.isfinite(distance), distance, around.distance), detail, grain, np.max(widths, axis=0))


def albedos(media, colours):
    """(media, 3) linear sRGB, 0 to 1, of a scattering in each `regions.Medium`."""
    return np.clip([colours.to_rgb @ (medium.scatterer.albedo * colours.to_waves.sum(axis=1)) for medium in media], 0, 1)


def _at(world, grains, offset):
    """Body (H, W) whose grain is seen at a place in each pixel, -1: none;  normal (H, W, 3);  distance, radius (H, W) m."""
    height, width = world.size
    row, column = np.divmod(np.arange(height * width), width)
    origin, direction = world.camera_rays(np.tile(offset, (height * width, 1)), np.stack([row, column], axis=1))
    far = world.trace(origin, direction, np.inf)
    body, distance, normal = np.full(len(far), -1), np.full(len(far), np.inf), np.zeros((len(far), 3))
    radius = np.zeros(len(far))
    for number, first in enumerate(grains):
        its, turned, radii = first(origin, direction, far)
        nearer = its < distance
        body[nearer], distance[nearer], normal[nearer], radius[nearer] = number, its[nearer], turned[nearer], radii[nearer]
    normal *= -np.sign(np.einsum("nk,nk->n", normal, direction))[:, None]
    return *(layer.reshape(height, width, *layer.shape[1:]) for layer in (body, normal, distance, radius)),
