"""Single scattering by suspended spheres."""
