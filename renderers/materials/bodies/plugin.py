"""Translucent bodies as an integrator of Mitsuba (`bakery_translucent`), registered by `import
renderers.materials.bodies.plugin`.

Renders a scene whose shapes are translucent bodies, by the same passes as `bake render` of a scene of bodies.

Parameters
----------
body.ID : string
    The shape of this id is a body of the material of this asset, an HDF5 file with the stages medium and multiple.  Relative
    paths are searched where Mitsuba searches.  One for each body.
method, boundary : string
    As `method` and `boundary.tables` of a body in a scene; their defaults if absent.
unit : float
    m, length of 1 in the scene; default 1.

Usage::

    <integrator type="bakery_translucent">
        <string name="body.candle" value="wax.h5"/> <float name="unit" value="0.001"/>
    </integrator>

Pictures, cameras and variants: `renderers.pictures.integrator`.
"""

import bakery
from bakery.errors import UsageError
from renderers.materials.bodies.scene import METHODS, NEEDS
from renderers.pictures.integrator import length_of_one, one_of, register
from renderers.scene.entries import BOUNDARIES

import mitsuba as mi  # isort: skip

NAME, _BODY = "bakery_translucent", "body."


class Inside:
    """Which shapes are bodies, and how they are rendered.

    Raises UsageError, AssetError where the plugin's parameters are not what they should be.
    """

    def __init__(self, props):
        inside = [name for name, method in METHODS.items() if not (method.surface or method.surface_far)]  # a BSDF
        self.method = one_of(NAME, props, "method", inside, inside[0])
        self.boundary = one_of(NAME, props, "boundary", BOUNDARIES, BOUNDARIES[0])
        self.unit = length_of_one(NAME, props)
        self.assets = {}
        for key in list(props.keys()):
            if key.startswith(_BODY):
                asset = bakery.open(str(mi.file_resolver().resolve(props[key])))
                for stage in NEEDS:
                    getattr(asset, stage)
                self.assets[key.removeprefix(_BODY)] = asset
        self.filled = set(self.assets)
        if not self.assets:
            raise UsageError(f'{NAME}: no body; <string name="{_BODY}ID" value="wax.h5"/> would do, with the id of a shape')

    def __str__(self):
        return f"{', '.join(self.assets)}, {self.method}"

    def parts(self, world, seed):
        """Kinds of passes (`renderers.pictures.progressive.Part`)."""
        from renderers.materials.bodies import methods

        names, assets = list(self.assets), list(self.assets.values())
        setup = methods.transport_of(world, names, assets, [None] * len(names),
                                   lambda number, key, message: UsageError(f"{NAME}: {_BODY}{names[number]}: {message}"),
                                   self.method)
        return methods.of(setup, self.method, self.boundary, seed)[1]


register(NAME, Inside)
