"""Bakery bakes scattering materials for rendering: recipes in, one HDF5 asset out.

`import bakery` loads nothing heavy; what is named here is loaded on first use.
"""

from importlib import import_module

TYPE_CHECKING = False  # typing's own takes 15 ms to load

__version__ = "0.1.0"

if TYPE_CHECKING:
    from bakery import goa, mie
    from bakery.asset import Asset, Family, from_xarray, open
    from bakery.errors import AssetError, BakeryError, RecipeError, StageError, StoreError, UsageError
    from bakery.run.bake import bake

_WHERE = {
    "Asset": "bakery.asset",
    "AssetError": "bakery.errors",
    "BakeryError": "bakery.errors",
    "Family": "bakery.asset",
    "RecipeError": "bakery.errors",
    "StageError": "bakery.errors",
    "StoreError": "bakery.errors",
    "UsageError": "bakery.errors",
    "bake": "bakery.run.bake",
    "from_xarray": "bakery.asset",
    "open": "bakery.asset",
}

__all__ = ["Asset", "AssetError", "BakeryError", "Family", "RecipeError", "StageError", "StoreError", "UsageError", "bake",
           "from_xarray", "goa", "mie", "open"]


def __getattr__(name: str):
    if name in ("goa", "mie"):
        return import_module(f"bakery.{name}")
    if name in _WHERE:
        return getattr(import_module(_WHERE[name]), name)
    raise AttributeError(f"module 'bakery' has no attribute {name!r}")


def __dir__():
    return sorted(list(globals()) + __all__)
