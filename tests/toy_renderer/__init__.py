"""A toy renderer: an endless haze under a sun that nothing dims, scattered once.  What a renderer's folder has to hold.

Along any ray the integral of sigma_s exp(-sigma_t t) over t is the albedo: radiance = albedo phase(angle to the sun) irradiance.
"""

import numpy as np

from renderers.camera import Camera
from renderers.pictures.running import Render, describe

__all__ = ["describe", "render"]


def render(scene, output=None, *, overrides=None, quality=None, variant=None, seed=None, overwrite=False, progress=None):
    """Renders a scene file to a PNG and an EXR file beside each other; as all renderers of scenes are called."""
    from bakery.kernels import phase_layout
    from tests.toy_renderer.kernels import glow

    job = Render(scene, output, overrides=overrides, overwrite=overwrite, progress=progress)
    toy, film, medium = job.scene.values.toy, job.scene.values.film, job.asset.medium
    height, width = film.height or 6, film.width or 8
    rays = Camera.looking(**dict(job.scene.values.camera), height=height, width=width).rays(height, width)
    sun = np.array(toy.sun) / np.linalg.norm(toy.sun)
    rgb, tell = np.empty(rays.shape), job.progress(0.0, 1.0)
    for channel in range(3):
        phase = medium["phase"][channel] if toy.method == "single" else np.full(len(medium.theta), 1 / (4 * np.pi))
        glow(*phase_layout(medium.theta, phase), rays, sun, medium.albedo[channel], rgb[..., channel])
        if tell:
            tell((channel + 1) / 3)
    job.part_over("haze")
    return job.finish(rgb, method=toy.method, reasons=["light that is scattered more than once is left out"])
