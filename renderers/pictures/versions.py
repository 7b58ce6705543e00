"""Versions of what decides the bytes of a picture."""

from importlib.metadata import PackageNotFoundError, version

import bakery
from renderers.pictures import denoise

_LIBRARIES = ("mitsuba", "drjit", "numba", "numpy", "scipy", denoise.PACKAGE)


def versions() -> dict[str, str]:
    """Of bakery and the libraries that render, by name; "" of one that is not installed."""
    return {"bakery": bakery.__version__} | {name: _version(name) for name in _LIBRARIES}


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return ""
