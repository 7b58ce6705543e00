"""All stages, in the order in which a plan runs them."""

from __future__ import annotations

from functools import cache

from bakery.stages.declaration import Stage


@cache
def all_stages() -> tuple[Stage, ...]:
    """Every declared stage, upstream ones first."""
    from bakery.stages import beam, effective, grains, medium, multiple, optics, packing

    return (packing.STAGE, grains.STAGE, optics.STAGE, medium.OF_PARTICLES, medium.OF_COEFFICIENTS, effective.OF_GRAINS,
            multiple.STAGE, beam.STAGE)
