"""Grains: single particles that are large against the wavelength, as geometry with a surface and an interior."""
