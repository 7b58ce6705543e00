"""Event by event near the camera, the surface that is baked far from it."""

from renderers.materials.bodies.declaration import BodyMethod
from renderers.materials.bodies.declaration import unfit as unfilled


def deviation(scene, number, asset, world) -> float:
    """Of the far part, as far as light spreads, over pixels and over the radius of the body."""
    from renderers.materials.surface import onset

    return onset.of(scene, number, asset, world).error


def far_share(scene, number, asset, world) -> float:
    """Of what the camera sees of the body."""
    from renderers.materials.surface import onset

    return onset.of(scene, number, asset, world).share


def unfit(scene, number, asset, world) -> str:
    """Nothing can fill the shape, or no baked surface is that of what does."""
    from renderers.materials.surface import onset

    return unfilled(scene, number, asset, world) or onset.unfit(scene.values.materials[number], asset, world)


METHOD = BodyMethod(
    name="paths+surface", words="event by event near the camera, and far from it the shape's surface by the reflectance of the "
                                "asset's plane layer", keys=("layer", "surface_from"), points=(), measured=None,
    deviation=deviation, unfit=unfit, beside=True, surface_far=True, far_share=far_share, stages=("medium", "surface"),
    brings="from the eye, event by event in what is near the camera; what is far sends light on as a plane layer does (stage "
           "surface); between, each path goes one of both ways, by chance",
    leaves_out="far from the camera light leaves where it came in, as if under a plane that is lit evenly: shadows and edges are "
               "sharper there, and thin parts darker, than light makes them that spreads in the material")
