"""The shape as a surface that is baked: no path goes inside."""

from renderers.materials.bodies.declaration import BodyMethod


def deviation(scene, number, asset, world) -> float:
    """As far as light spreads, over pixels and over the radius of the body."""
    from renderers.materials.surface import far

    return far.deviation(scene, number, asset, world)


def unfit(scene, number, asset, world) -> str:
    """No baked surface, or that of something else than what fills the shape."""
    from renderers.materials.surface import far

    return far.unfit(scene.values.materials[number], asset, world)


METHOD = BodyMethod(
    name="surface", words="the shape's surface by the reflectance of the asset's plane layer, from afar", keys=("layer",),
    points=(), measured=None, deviation=deviation, unfit=unfit, beside=True, surface=True, stages=("medium", "surface"),
    brings="from the eye; at the shape's surface light is sent on as by a plane layer (stage surface), where lights are sampled",
    leaves_out="light leaves where it came in, as if under a plane that is lit evenly: shadows and edges are sharper, and thin "
               "parts darker, than light makes them that spreads in the material")
