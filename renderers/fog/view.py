"""What a camera sees of a picture through fog: how much of it along each ray, and what the filter makes of a picture."""

from functools import cached_property

import numpy as np

from renderers.fog import filter as screen_filter
from renderers.fog import noise
from renderers.pictures import images

_ENDLESS = 1000.0  # times the reach of fog that ends: where pixels without a surface are taken to lie; 2e-3 from infinity


class View:
    """Fog along the rays of a camera, to the surfaces.

    rays, origin : (H, W, 3), (3,) m
    distance : (H, W) m, finite
    sky : (H, W), which pixels have no surface
    depth : (H, W, 3), optical depth;  through : exp(-depth)
    ambient : (3,), radiance from all around
    energy, outside : as the scene says, or by default
    """

    def __init__(self, scene, medium, density, camera, distance, points="final", card=False):
        """
        scene : `renderers.scene.Scene`
        medium : kernels.Fog of 3 channels
        density : of `renderers.fog.density`
        camera : `renderers.camera.Camera`
        distance : (H, W) m, inf where there is no surface
        points : of `filter.POINTS`
        card : whether the filter runs on a graphics card, with points at every pixel
        """
        height, width = distance.shape
        self._medium, self._filter = medium, scene.values.filter
        self.points, self._card = "every pixel" if card else points, card
        self.rays, self.origin = camera.rays(height, width), camera.origin
        self.distance, self.sky = finite(scene, density, self.origin, distance)
        moments = density.integrals(self.origin, self.rays.reshape(-1, 3), self.distance.ravel()).reshape(height, width, 3)
        self._column = moments[..., 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            lever = np.where(self._column > 0, np.sqrt(3 * moments[..., 2] / self._column), self.distance)
        self._geometry = camera.angle(height, width), self.distance, self._column, lever
        self.depth = self._column[..., None] * spread(medium.sigma_t)
        self.through = np.exp(-self.depth)
        # linear in the light: with L all around one sees L but for what is absorbed, and surfaces differ from L by col - L
        self.ambient = sum((spread(light.radiance) for light in scene.values.fog.light if light.type == "ambient"), np.zeros(3))
        outside, energy = ("black", "lost") if self.ambient.any() else ("edge", "kept")
        self.outside, self.energy = self._filter.outside or outside, self._filter.energy or energy

    def seen(self, rgb, progress=None):
        """A picture (H, W, 3) through the fog, without light of suns."""
        result = self._fogged(rgb - self.ambient, *self._geometry, progress)
        # where nearer things absorb less than a pixel's own path the sum is too small: no less than the unscattered light
        return np.maximum(result + self._glow, self.through * rgb) if self.ambient.any() else result

    def unsure(self, rgb):
        """What the fog makes of an error (H, W, 3) of the picture, see `noise.filtered`."""
        return noise.filtered(rgb, self.through, self._geometry, self._fogged)

    def noise(self, rgb, error) -> float:
        """Relative noise in the fog of a picture with an error; suns would make it less."""
        seen = self.unsure(rgb - self.ambient) + self._glow
        return images.relative_noise(seen, self.unsure(error))

    def _fogged(self, rgb, angle, distance, column, lever, progress=None):
        arguments = rgb, distance, angle, column, lever, self._medium
        options = {"energy": self.energy, "outside": self.outside, "cut_off": self._filter.cut_off}
        if self._card:
            from renderers.fog import on_drjit

            return on_drjit.fogged(*arguments, **options)
        return screen_filter.fogged(*arguments, **options, points=self.points, progress=progress)

    @cached_property
    def _glow(self):
        """Ambient light that reaches the camera from everywhere."""
        if not self.ambient.any():
            return 0.0
        return self.ambient * (self.through + sum(self._medium.powers(self._column, self.energy)))


def finite(scene, density, origin, distance):
    """Distances with those of pixels without a surface at `far`, and which pixels these are."""
    sky, far = np.isinf(distance), scene.values.picture.far
    farthest = float(distance[~sky].max(initial=0.0))
    if far is not None and far < farthest:
        raise scene.wrong("picture.far", f"found {far:g} m, nearer than the farthest surface; {farthest:.4g} m or more would do")
    if far is None and sky.any():
        reach = density.reach(origin)
        if not np.isfinite(reach):
            y, x = np.argwhere(sky)[0]
            raise scene.wrong("picture", f"found {sky.sum():,} pixels without a surface (the first in row {y}, column {x}) in "
                              "fog that goes on for ever; `far: 1 km`, where they are taken to lie, would do")
        far = max(_ENDLESS * reach, farthest, 1.0)
    return np.where(sky, far, distance), sky


def spread(values):
    """Red, green and blue from one value or three."""
    return np.broadcast_to(np.asarray(values, float), 3)
