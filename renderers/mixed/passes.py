"""Pictures of several materials by paths in wavefronts: their passes, as `renderers.pictures.progressive` takes them."""

from functools import partial

import numpy as np

from renderers.pictures.engine import Part, by_samples, layers_of
from renderers.transport import regularised, waves

_PATHS, _SAMPLES = 1 << 17, 16  # of a pass, at most, where a pixel has several; and of a pixel
_OF_PILOTS = 4  # samples of a pixel: two passes of each of their pictures are rendered in any case
_FIRST = "first"  # layers: shares of a pixel's paths that materials were the first to scatter, three a layer


def part(name, scene, seed) -> Part:
    """Passes of paths through a `renderers.transport.waves.Scene`."""
    height, width = scene.world.size
    most = _SAMPLES if scene.world.whole is None else _OF_PILOTS
    samples = max(1, min(most, round(_PATHS / (height * width))))
    return by_samples(name, partial(_rendered, scene, (height, width), seed), samples)


def _rendered(scene, size, seed, samples, number):
    """Layers of a pass."""
    scene = scene._replace(chord=regularised.chord(scene.angle, samples * (number + 1)))
    sums = waves.one_pass(scene, size, number, seed, samples)
    images = layers_of(sums.by_order, sums.by_light, scene.world.light_names)
    shares = np.zeros((-(-len(sums.first) // 3) * 3, sums.first.shape[1]))
    shares[:len(sums.first)] = sums.first
    images |= {f"{_FIRST}{k}": np.ascontiguousarray(three.T) for k, three in enumerate(shares.reshape(-1, 3, shares.shape[1]))}
    return {layer: image.reshape(*size, 3) / samples for layer, image in images.items()}


def first_shares(means):
    """Shares (H, W, materials) of a pixel's paths that each material was the first to scatter; of means."""
    (mean,) = means
    names = sorted((name for name in mean.layers if name.startswith(_FIRST)), key=lambda name: int(name[len(_FIRST):]))
    return np.concatenate([mean.layers[name] for name in names], axis=-1).astype(float)


def material_layer(shares):
    """Layer `material` (H, W): the entry in which most of a pixel's paths scattered first, of those that did; -1 where none
    did."""
    return np.where(shares.any(axis=-1), shares.argmax(axis=-1), -1).astype(np.float32)
