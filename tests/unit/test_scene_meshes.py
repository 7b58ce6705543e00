"""Meshes of the shipped scenes that stand for what is poured: natural slopes, and milk that its glass holds."""

import numpy as np
import pytest
import trimesh

from tests.conftest import ROOT

SCENES = ROOT / "assets" / "scenes"


def test_a_heap_has_the_slopes_of_dry_sand():
    """No face is steeper than 38 degrees, half of the sides lies within 3 of 33, and the rim is a layer of grains high."""
    heap = trimesh.load(SCENES / "heap.ply")
    assert heap.is_watertight and heap.volume > 0
    steep = np.degrees(np.arccos(np.clip(heap.face_normals[:, 2], -1, 1)))
    sides = (steep > 1) & (steep < 85)
    area = heap.area_faces[sides]
    assert steep[sides].max() < 38
    assert area[abs(steep[sides] - 33) < 3].sum() > 0.5 * area.sum()
    rim = heap.vertices[np.hypot(*heap.vertices[:, :2].T) > 0.93]
    assert 20 * rim[:, 2].max() > 0.5  # mm, the width of a grain, in a heap of 20 mm


def test_milk_rises_at_its_glass_and_stays_in_it():
    milk, glass = (trimesh.load(SCENES / f"{name}.ply") for name in ("milk", "tumbler"))
    assert milk.is_watertight and glass.is_watertight
    assert glass.volume > milk.volume > 0
    radius, height = np.hypot(*milk.vertices[:, :2].T), milk.vertices[:, 2]
    level = height[radius < 5].max()
    assert 1 < height.max() - level < 3 and radius[height > level + 0.9].min() > 20
    shared = trimesh.boolean.intersection([milk, glass], engine="manifold")
    assert shared.volume == pytest.approx(milk.volume, rel=1e-6)
