"""Grains as an integrator of Mitsuba (`bakery_granular`), registered by `import renderers.materials.grains.plugin`.

Renders a scene with grains in it, by the same passes as `bake render` of a scene of grains.  Shapes inside of the
integrator say what the grains fill; they are not seen themselves.

Parameters
----------
asset : string
    The asset, an HDF5 file with the stages grains, packing and medium.  Relative paths are searched where Mitsuba searches.
method : string
    As `method` of grains in a scene; its default if absent.
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

Pictures, cameras and variants: `renderers.pictures.integrator`.
"""

import numpy as np

import bakery
from bakery.errors import UsageError
from bakery.store import ply
from renderers.materials.grains.scene import CHOICE, NEEDS
from renderers.pictures.integrator import length_of_one, one_of, register

import mitsuba as mi  # isort: skip

NAME, METHODS = "bakery_granular", CHOICE[1]


class Inside:
    """What is inside of a plugin's meshes, and how it is rendered.

    Raises UsageError, AssetError where the plugin's parameters are not what they should be.
    """

    def __init__(self, props):
        self.method, self.unit = one_of(NAME, props, "method", METHODS, METHODS[0]), length_of_one(NAME, props)
        asset = props.get("asset", None)
        if asset is None:
            raise UsageError(f'{NAME}: no asset; <string name="asset" value="sand.h5"/> would do')
        self.asset = bakery.open(str(mi.file_resolver().resolve(asset)))
        for stage in NEEDS:
            getattr(self.asset, stage)
        self.filled = set()  # the mesh is none of the scene's shapes
        self.mesh = self._mesh([shape for _, shape in props.objects() if isinstance(shape, mi.Shape)])

    def __str__(self):
        return f"{self.asset.path}, {self.method}"

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

    def parts(self, world, seed):
        """Kinds of passes (`renderers.pictures.progressive.Part`)."""
        from renderers.materials.grains import material, methods

        assets, meshes = [self.asset], [self.mesh]
        return methods.of(self.method, world, assets, meshes, [material.grains_of(self.asset, *self.mesh)], seed).parts


def _called(shape):
    return shape.id() or shape.class_name()


register(NAME, Inside)
