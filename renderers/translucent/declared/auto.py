"""The cheapest method that keeps the tolerance."""

from __future__ import annotations

from renderers.translucent.declaration import BodyMethod
from renderers.translucent.declared import vrl_tables


def choose(densities, have_tables) -> str:
    """Spheres where beams would be few on a body, else tables where all bodies have them."""
    from renderers.translucent import thin

    if max(densities) < thin.DENSE or min(densities) < vrl_tables.METHOD.fewest_beams:
        return "shells"
    return "vrl+tables" if have_tables else "paths"


METHOD = BodyMethod(
    name="auto", words="vrl+tables, or paths for thin bodies without tables, or shells for very large ones", keeps=True,
    keys=("boundary.tables",), candidates=("vrl+tables", "paths", "shells"), points=(), reads_tables=True, choose=choose,
    error=vrl_tables.METHOD.error, brings="as the method that it takes")
