"""From grain to grain first, then in the medium, with diffusion far inside."""

from renderers.materials.grains.declaration import GrainMethod

METHOD = GrainMethod(
    name="ept+vpt+da", words="the same, and by diffusion far inside", medium=True, widens=True, diffuses=True, ends_early=True,
    keys=("spread", "widen"),
    points=("", "spread=1"),
    error=lambda tolerance: 0.024,  # largest of eight scenes
    brings="as ept+vpt, with diffusion in spheres that lie in the medium")
