"""The index of refraction of a body, which its scene and the BSDF of its shape both state."""

from __future__ import annotations


def index_fault(shape: str, index: float | None, bsdf: float) -> str:
    """What is wrong with the index that a scene says of a shape whose BSDF has `bsdf`; "" where it is that, or none is said."""
    if index is None or abs(index - bsdf) <= 1e-3 * index:
        return ""
    return f"found {index:g}, and the BSDF of {shape} has {bsdf:g}; the same would do"
