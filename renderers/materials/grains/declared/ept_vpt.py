"""From grain to grain first, then in the medium."""

from renderers.materials.grains.declaration import GrainMethod

METHOD = GrainMethod(
    name="ept+vpt", words="from grain to grain first, then in the medium", medium=True, widens=True,
    keys=("spread", "widen"), points=("", "spread=1"),
    error=lambda tolerance: 0.024,  # largest of eight scenes
    brings="light at grains up to where paths of neighbouring pixels come apart, later light in the medium")
