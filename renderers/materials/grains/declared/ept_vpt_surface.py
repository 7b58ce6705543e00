"""From grain to grain near the camera, then in the medium; far from it the surface that is baked."""

from renderers.materials.grains.declaration import GrainMethod
from renderers.materials.grains.declared import ept_vpt


def deviation(scene, number, asset, world) -> float:
    """Of the far part, as far as light spreads, over pixels and over the radius of the body, and as grains are seen singly."""
    from renderers.materials.grains import far

    return far.onset_of(scene, number, asset, world, METHOD).error


def far_share(scene, number, asset, world) -> float:
    """Of what the camera sees of the body."""
    from renderers.materials.grains import far

    return far.onset_of(scene, number, asset, world, METHOD).share


def unfit(scene, number, asset, world) -> str:
    """No baked surface is that of packed grains that fill a mesh and are the same everywhere."""
    from renderers.materials.grains import far

    return far.unfit(scene.values.materials[number], asset)


METHOD = GrainMethod(
    name="ept+vpt+surface",
    words="near the camera from grain to grain, then in the medium; far from it the mesh's surface by the reflectance of a plane "
          "of grains",
    medium=True, widens=True, keys=("spread", "widen", "surface_from"), points=(), surface_far=True, deviation=deviation,
    unfit=unfit, far_share=far_share, error=ept_vpt.METHOD.error,
    stages=("grains", "packing", "medium", "surface"),
    brings="as ept+vpt in what is near the camera; what is far sends light on as a plane of grains does (stage surface); between "
           "both, each path goes one of both ways, by chance",
    leaves_out="far from the camera light leaves where it came in, as if under a plane that is lit evenly: shadows and edges are "
               "sharper there than light makes them that spreads among grains, and no grain is to be seen")
