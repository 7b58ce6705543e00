"""The medium that stands for the grains."""

from __future__ import annotations

from renderers.materials.grains.declaration import GrainMethod

METHOD = GrainMethod(
    name="vpt", words="the continuous medium that stands for the grains", medium=True, continuous=True, beside=True,
    error=lambda tolerance: 0.264,  # largest of eight scenes
    brings="the asset's effective medium in the mesh", leaves_out="the medium that stands for the grains: no grain is to be seen")
