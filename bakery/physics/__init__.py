"""Physics of scattering: arrays in, arrays out."""
