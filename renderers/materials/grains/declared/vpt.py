"""The medium that stands for the grains."""

from renderers.materials.grains.declaration import GrainMethod


def deviation(scene, number, asset, world) -> float:
    """N grains that a pixel sees, whose brightness differs as much as it is, deviate by one over the root of N: by their width in
    pixels, and single ones that are wider by no more than that of one."""
    from renderers.materials.grains import material
    from renderers.scene import meshes

    vertices, faces = meshes.of_entry(scene, number)
    return min(material.pixels_wide(world, vertices[faces], material.largest_of(asset)), 1.0)


METHOD = GrainMethod(
    name="vpt", words="the continuous medium that stands for the grains", medium=True, continuous=True, beside=True,
    deviation=deviation,
    error=lambda tolerance: 0.264,  # largest of eight scenes
    brings="the asset's effective medium in the mesh", leaves_out="the medium that stands for the grains: no grain is to be seen")
