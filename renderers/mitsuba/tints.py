"""Colours of a Mitsuba scene's lights and surfaces, and how well a few wavelengths hold them."""

import mitsuba as mi
import numpy as np

from renderers import colour

_SHARES = {"radiance", "intensity", "irradiance", "texture", "reflectance", "diffuse_reflectance", "specular_reflectance",
           "specular_transmittance", "base_color"}
_DRAWN = 256  # light samples that tell the colour of suns and skies


def of(world) -> np.ndarray:
    """Colours (N, 3) linear sRGB of the lights and surfaces of a `renderers.mitsuba.world.World`, means of those that are
    pictures; black ones are left out."""
    things = [*world.scene.emitters(), *(shape.bsdf() for shape in world.scene.shapes() if shape.bsdf() is not None)]
    rows = [np.zeros((1, 3))]
    for thing in {id(thing): thing for thing in things}.values():
        for key, value in mi.traverse(thing).items():
            if key == "data" or key.count(".") and key.split(".")[-2] in _SHARES:
                values = np.array(value, float)
                if isinstance(value, mi.Color3f):
                    rows.append(values.reshape(3, -1).mean(axis=1)[None])
                elif values.ndim == 3 and values.shape[-1] >= 3:
                    rows.append(values[..., :3].mean(axis=(0, 1))[None])
    if world.sky:
        middle = np.zeros((1, 3)) if world.box is None else world.box.mean(axis=0, keepdims=True)
        index = np.arange(_DRAWN)
        evenly = np.stack([(index + 0.5) / _DRAWN, index * 0.618034 % 1], axis=1)
        rows.append(world.lights(np.repeat(middle, _DRAWN, axis=0), evenly, hidden=False).radiance.mean(axis=0)[None])
    colours = np.concatenate(rows)
    return colours[(colours > 0).any(axis=1)]


def lost(world, wavelength) -> float:
    """Largest error of a channel of these colours, over the colour's largest channel, as wavelengths (L,) um hold them; 0 of a
    red, a green and a blue one."""
    if colour.rgb_order(wavelength) is not None:
        return 0.0
    colours = np.maximum(of(world), 0.0)
    held = colours @ (colour.srgb_matrix(wavelength) @ colour.spread_matrix(wavelength)).T
    return float(np.max(np.abs(held - colours).max(axis=1) / colours.max(axis=1), initial=0.0))
