"""Paths from grain to grain, with small lamps wider than they are."""

from renderers.materials.grains.declaration import GrainMethod
from renderers.materials.grains.declared.ept import LITTLE, smooth


def lacks(assets, world) -> str:
    """What is the same as ept takes no pilot."""
    return "" if smooth(assets) and world.small_share > LITTLE else "it is ept where no small lamp shines on smooth grains"


METHOD = GrainMethod(
    name="ept+wide", words="the same, with small lamps wider in smooth grains", keys=("widen",), widens=True, beside=True,
    lacks=lacks,
    error=lambda tolerance: 0.02,  # a heap of beads in a distant lamp, after 8 samples (docs/measurements/granular.md)
    brings="as ept; a small lamp is met by way of smooth grains as a disc of the same power, which shrinks with samples",
    leaves_out="smooth grains show small lamps as discs: glints and caustics are less sharp than those of the lamps")
