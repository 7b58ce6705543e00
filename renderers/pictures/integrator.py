"""Renderers of bakery as integrators of Mitsuba: what their plugins have in common.

`mitsuba.render(scene, sensor=…, spp=…, seed=…)` gives the picture, and the sensor's film holds it.  Perspective cameras, and
variants that work on arrays of colours (`llvm_ad_rgb`, `cuda_ad_rgb`).  A pixel is the mean over its square, whatever filter the
film has, and 0 where that is below 0, as beams of negative power leave it.
"""

import numpy as np

from bakery.errors import UsageError
from renderers.mitsuba.scene import noted  # before mitsuba: it finds LLVM, once

import mitsuba as mi  # isort: skip


def define(name, inside):
    """The plugin's class for the variant that is set; its base class is another in every variant.

    name : of the plugin
    inside : class, made of Mitsuba's properties, with `parts(world, seed)`, kinds of passes
        (`renderers.pictures.progressive.Part`), `unit`, m, and `filled`, names of shapes of the scene that have something in them
    """

    class Integrator(mi.SamplingIntegrator):  # the simplest class of integrators that Python may extend
        def __init__(self, props):
            super().__init__(props)
            if not mi.variant().endswith("_ad_rgb"):
                raise UsageError(f"{name}: variant {mi.variant()}; expected one that works on arrays of colours, such as "
                                 "llvm_ad_rgb")
            self.inside = inside(props)

        @noted
        def render(self, scene, sensor, seed=0, spp=0, develop=True, evaluate=True):
            picture = _picture(self.inside, scene, sensor, int(seed), int(spp) or sensor.sampler().sample_count())
            film = sensor.film()
            film.prepare([])
            samples = np.ones((*picture.shape[:2], film.create_block().tensor().shape[2]), np.float32)  # weight and opacity: 1
            samples[..., :3] = picture
            film.put_block(mi.ImageBlock(mi.TensorXf(samples), film.crop_offset(), film.rfilter(), border=False))
            return film.develop() if develop else mi.TensorXf()

        def to_string(self):
            return f"{name}[{self.inside}]"

    return Integrator


def length_of_one(name, props):
    """The property `unit`, m; UsageError where it is none."""
    unit = props.get("unit", 1.0)
    if not unit > 0:
        raise UsageError(f"{name}: unit: found {unit:g}, expected the length of 1 in the scene, m")
    return unit


def one_of(name, props, key, choices, default):
    """A property that is one of some words; UsageError where it is another."""
    value = props.get(key, default)
    if value not in choices:
        raise UsageError(f'{name}: {key}: found "{value}", expected {", ".join(choices)}')
    return value


def register(name, inside) -> None:
    """Registers a plugin in every variant that is set from now on, and in the one that is set now."""

    def anew(old=None, new=None):
        if mi.variant() is not None:
            mi.register_integrator(name, noted(define(name, inside)))

    mi.detail.add_variant_callback(anew)
    anew()


def _picture(inside, scene, sensor, seed, samples):
    """(H, W, 3) linear sRGB, the mean of `samples` a pixel, and nothing below 0, as in the pictures of scenes."""
    from renderers.mitsuba.world import World
    from renderers.pictures.means import LEAST, Mean

    picture = 0.0
    for part in inside.parts(World(scene, inside.unit, sensor=sensor, filled=inside.filled), seed):
        mean = Mean()
        for number in range(max(LEAST, -(-samples // part.samples))):  # as scenes have, for their noise
            mean.add(part.render(number))
        picture = picture + mean.layers[""]
    return np.maximum(picture, 0.0)
