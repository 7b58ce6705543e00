"""Grains as an integrator of Mitsuba (`bakery_granular`), registered by `import renderers.granular.plugin`.

Renders a scene with grains in it, by the same passes as `bake render` of a scene with a section `granular`.  Shapes inside of the
integrator say what the grains fill; they are not seen themselves.

Parameters
----------
asset : string
    The asset, an HDF5 file with the stages grains, packing and medium.  Relative paths are searched where Mitsuba searches.
method : string
    As `granular.method` of a scene; its default if absent.
unit : float
    m, length of 1 in the scene; default 1.
(nested shapes)
    Closed meshes with their `to_world`, which do not overlap: grains whose centre is inside are there.

Usage::

    <integrator type="bakery_granular">
        <string name="asset" value="sand.h5"/> <float name="unit" value="0.001"/>
        <shape type="ply"> <string name="filename" value="cone.ply"/> <transform name="to_world"> <scale value="9"/> </transform>
        </shape>
    </integrator>

`mitsuba.render(scene, sensor=…, spp=…, seed=…)` gives the picture, and the sensor's film holds it.  Perspective cameras, and
variants that work on arrays of colours (`llvm_ad_rgb`, `cuda_ad_rgb`).  A pixel is the mean over its square, whatever filter the
film has.
"""

from __future__ import annotations

import numpy as np

import bakery
from bakery.errors import UsageError
from bakery.store import ply
from renderers.granular.scene import METHODS, NEEDS, Granular
from renderers.mitsuba.scene import noted  # before mitsuba: it finds LLVM, once

import mitsuba as mi  # isort: skip

NAME, DEFAULT = "bakery_granular", Granular.model_fields["method"].default


def define():
    """The plugin's class for the variant that is set; its base class is another in every variant."""

    class Integrator(mi.SamplingIntegrator):  # the simplest class of integrators that Python may extend
        def __init__(self, props):
            super().__init__(props)
            shapes = [shape for _, shape in props.objects() if isinstance(shape, mi.Shape)]
            self.inside = Inside(props.get("asset", None), props.get("method", DEFAULT), props.get("unit", 1.0), shapes)

        def render(self, scene, sensor, seed=0, spp=0, develop=True, evaluate=True):
            picture = self.inside.picture(scene, sensor, int(seed), int(spp) or sensor.sampler().sample_count())
            film = sensor.film()
            film.prepare([])
            samples = np.ones((*picture.shape[:2], film.create_block().tensor().shape[2]), np.float32)  # weight and opacity: 1
            samples[..., :3] = picture
            film.put_block(mi.ImageBlock(mi.TensorXf(samples), film.crop_offset(), film.rfilter(), border=False))
            return film.develop() if develop else mi.TensorXf()

        def to_string(self):
            return f"{NAME}[{self.inside.asset.path}, {self.inside.method}]"

    return Integrator


class Inside:
    """What is inside of a plugin's meshes, and how it is rendered.

    Raises UsageError, AssetError where the plugin's parameters are not what they should be.
    """

    def __init__(self, asset, method, unit, shapes):
        if not mi.variant().endswith("_ad_rgb"):
            raise UsageError(f"{NAME}: variant {mi.variant()}; one that works on arrays of colours would do, such as llvm_ad_rgb")
        if method not in METHODS:
            raise UsageError(f'{NAME}: method: found "{method}", expected {", ".join(METHODS)}')
        if not unit > 0:
            raise UsageError(f"{NAME}: unit: found {unit:g}, expected the length of 1 in the scene, m")
        if asset is None:
            raise UsageError(f'{NAME}: no asset; <string name="asset" value="sand.h5"/> would do')
        self.asset, self.method, self.unit = bakery.open(str(mi.file_resolver().resolve(asset))), method, unit
        for stage in NEEDS:
            getattr(self.asset, stage)
        self.mesh = self._mesh(shapes)

    def _mesh(self, shapes):
        """Vertices (V, 3) m and triangles (F, 3)."""
        from bakery import kernels

        if not shapes:
            raise UsageError(f'{NAME}: no shape to fill; <shape type="ply">…</shape> inside of the integrator would do')
        parts, count = [], 0
        for shape in shapes:
            if not shape.is_mesh():
                raise UsageError(f"{NAME}: {_called(shape)} is no mesh; ply, obj or cube would do")
            vertices = np.array(shape.vertex_positions_buffer(), float).reshape(-1, 3)
            parts.append((vertices, np.array(shape.faces_buffer(), np.int64).reshape(-1, 3) + count))
            count += len(vertices)
        try:
            vertices, faces = kernels.closed_mesh(ply.mesh(*map(np.concatenate, zip(*parts))), "ply")
        except ValueError as fault:
            raise UsageError(f"{NAME}: {', '.join(map(_called, shapes))}: {fault}") from None
        return self.unit * vertices, faces

    def picture(self, scene, sensor, seed, samples):
        """(H, W, 3) linear sRGB, the mean of `samples` a pixel."""
        from renderers.mitsuba.world import World
        from renderers.progressive import Mean

        picture = 0.0
        for part in self._parts(World(scene, self.unit, sensor=sensor), seed):
            mean = Mean()
            for number in range(-(-samples // part.samples)):
                mean.add(part.render(number))
            picture = picture + mean.layers[""]
        return picture

    def _parts(self, world, seed):
        """Kinds of passes (`renderers.progressive.Part`)."""
        from renderers.granular import material, methods

        assets, meshes = [self.asset], [self.mesh]
        return methods.of(self.method, world, assets, meshes, [material.grains_of(self.asset, *self.mesh)], seed).parts


def _called(shape):
    return shape.id() or shape.class_name()


def register() -> None:
    """Registers the plugin in the variant that is set now; no effect where none is set."""
    if mi.variant() is not None:
        mi.register_integrator(NAME, noted(define()))


mi.detail.add_variant_callback(lambda old, new: register())
register()
