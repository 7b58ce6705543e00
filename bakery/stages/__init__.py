"""All stages, in the order in which a plan runs them."""

from __future__ import annotations

from functools import cache

from bakery.stages.declaration import Stage


@cache
def all_stages() -> tuple[Stage, ...]:
    """Every declared stage, upstream ones first."""
    from bakery.stages.beam import stage as beam
    from bakery.stages.effective import stage as effective
    from bakery.stages.grains import stage as grains
    from bakery.stages.medium import stage as medium
    from bakery.stages.multiple import stage as multiple
    from bakery.stages.optics import stage as optics
    from bakery.stages.packing import stage as packing

    return (optics.STAGE, packing.STAGE, grains.STAGE, medium.OF_PARTICLES, medium.OF_COEFFICIENTS, effective.OF_GRAINS,
            multiple.STAGE, beam.STAGE)
