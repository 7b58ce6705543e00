"""Names of the scattering matrix's elements beside the phase function."""

from __future__ import annotations

ELEMENTS = ("s12", "s33", "s34")
