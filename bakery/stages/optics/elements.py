"""Names of the scattering matrix's elements beside the phase function."""

ELEMENTS = ("s12", "s33", "s34")
