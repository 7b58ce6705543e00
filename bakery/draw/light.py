"""The light of sun and sky on what a picture shows, by a depth buffer for each direction."""

from collections.abc import Iterator

import numpy as np

from bakery.draw.view import along, looking_from

_SUN, _SUN_SHARE, _SPREAD = (-0.55, 0.66, 0.51), 0.62, 0.20  # towards it; share of the lights in it; its radius, sine
_SUNS, _SKIES = 5, 9  # directions
_GOLDEN = 2.399963  # angle between one and the next


def shaded(position, normal, colour, gloss: float, shadow, thick: float = 1.0) -> np.ndarray:
    """Linear light (P, 3) of places on surfaces.

    position, normal : (3, P) in the frame of the view
    colour : (3,) or (P, 3) linear, of the surfaces
    gloss : strength of highlights
    shadow : (3, 3) frame of a light -> z of what is nearest to it, of a square of pixels, its lower left corner, a pixel's edge;
        None where nothing stands in another's light
    thick : size of the bodies; places nearer to each other than 0.012 of it do not shade each other
    """
    light = np.zeros((position.shape[1], 3))
    upwards = np.array([0.0, 0.0, 1.0])
    position, normal = (np.ascontiguousarray(values, np.float32) for values in (position, normal))
    for rgb, towards, strength, shine in _lights():
        received, glint = np.zeros((2, position.shape[1]), np.float32)
        for direction, share in zip(towards, strength, strict=True):
            frame = looking_from(direction)
            facing = share * cosines_of_light(position, normal, direction, frame, shadow(frame), thick)
            received += facing
            if shine > 0:
                half = direction + upwards
                glint += share * (facing > 0) * _to_48(np.maximum(along(half / np.linalg.norm(half), normal), 0))
        light += received[:, None] * (rgb * colour) + gloss * shine * glint[:, None] * rgb
    return light + 0.10 * (1 - np.clip(normal[2, :, None], 0, 1)) ** 3


def cosines_of_light(position, normal, towards, frame, shadow, thick: float = 1.0):
    """Cosines (P,) at which light from a direction meets places (3, P) with normals (3, P), 0 where something stands in it.

    shadow : what is nearest to the light, its lower left corner and the edge of a pixel, in the light's frame; None where nothing
        stands in it
    """
    facing = np.maximum(along(towards, normal), 0)
    if shadow is None:
        return facing
    depth, low, pixel = shadow
    x, y, z = (along(axis, position) for axis in frame)
    sine = np.sqrt(1 - np.minimum(facing, 1) ** 2)
    limit = z + np.float32(0.012 * thick) + np.float32(1.5 * pixel) * sine / np.maximum(facing, np.float32(0.15))
    u, v = (np.clip((at - np.float32(edge)) * np.float32(1 / pixel), 0, most - 1).astype(np.int32)
            for at, edge, most in ((x, low[0], depth.shape[1]), (y, low[1], depth.shape[0])))
    return facing * (depth.astype(np.float32).ravel()[v * depth.shape[1] + u] <= limit)


def _to_48(x):
    x = (x * x) ** 2
    x = (x * x) ** 2  # to the power of 16; NumPy's own power takes many times as long
    return x * x * x


def _lights() -> Iterator:
    """A sun of some width and a sky that is brighter above: (colour (3,), directions towards them, strengths, highlights)."""
    sun = np.array(_SUN) / np.linalg.norm(_SUN)
    radius, turn = _SPREAD * np.sqrt((np.arange(_SUNS) + 0.5) / _SUNS), _GOLDEN * np.arange(_SUNS)
    towards = np.stack([radius * np.cos(turn), radius * np.sin(turn), np.sqrt(1 - radius**2)], axis=1) @ looking_from(sun)
    yield 1.9 * _SUN_SHARE * np.array([1.0, 0.96, 0.88]), towards, np.full(_SUNS, 1 / _SUNS), 1.0
    z, turn = 1 - 2 * (np.arange(_SKIES) + 0.5) / _SKIES, _GOLDEN * np.arange(_SKIES)
    radius = np.sqrt(1 - z * z)
    towards = np.stack([radius * np.cos(turn), z, radius * np.sin(turn)], axis=1)
    yield 2.6 * (1 - _SUN_SHARE) * np.array([0.90, 0.97, 1.10]), towards, (0.55 + 0.45 * z) / _SKIES, 0.0
