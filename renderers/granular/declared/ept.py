"""Paths from grain to grain."""

from __future__ import annotations

from renderers.granular.declaration import GrainMethod

METHOD = GrainMethod(name="ept", words="paths from grain to grain", exact=True, beside=True,
                     brings="reflection, refraction and absorption at each grain's own surface")
