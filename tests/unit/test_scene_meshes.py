"""Meshes of the shipped scenes that stand for what is poured: natural slopes, and milk that its glass holds; meshes whose unit
does not fit their scene."""

import warnings
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh

from bakery.store import ply
from bakery.system.terminal import warned
from renderers import scene
from renderers.pictures import passes
from renderers.scene import meshes
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


@pytest.fixture
def mound(tmp_path):
    """A function of `where` and more keys: the entry of a cube, 120 units wide, in a scene in mm."""
    cube = trimesh.creation.box((120, 120, 120))
    (tmp_path / "mound.ply").write_bytes(ply.mesh(cube.vertices, cube.faces))
    (tmp_path / "s.xml").write_text("<scene version='3.0.0'/>")
    (tmp_path / "sand.yaml").write_text("bakery: 1\ngrains: {}\nmedium: {}\n")

    def of(where, unit="1 mm", more=""):
        (tmp_path / "s.yaml").write_text(f"bakery_scene: 2\nname: s\nscene: {{mitsuba: s.xml, unit: {unit}}}\nmaterials:\n"
                                         f"  - {{where: {{{where}}}, recipe: sand.yaml{more}}}\n")
        return scene.load(tmp_path / "s.yaml")

    return of


def around(origin, pixel=1e-3):
    """A world of 0.4 m around the origin, with a camera, as `doubts` looks at it."""
    return SimpleNamespace(box=np.array([[-0.2] * 3, [0.2] * 3]), camera=SimpleNamespace(origin=np.array(origin), pixel=pixel))


FAR, NEAR = (0.3, 0.0, 0.0), (0.05, 0.0, 0.0)  # beside the cube of 12 cm, and in it


@pytest.mark.parametrize("where, unit, more, origin, said", [
    ("mesh: mound.ply", "1 mm", "", FAR, "the camera is in the grains of materials[0]: mound.ply is 120 m across, as one unit "
     "of it is 1 m, as no unit: says otherwise; surfaces and camera span 50 cm. With unit: 1 mm beside mesh: it is 12 cm"),
    ("mesh: mound.ply", "1 mm", ", as: medium", FAR, "mesh: mound.ply is 120 m across"),
    ("mesh: mound.ply, unit: 1 m", "1 m", ", as: medium", FAR, "is 1 m; surfaces and camera span 50 cm. With unit: 1 mm"),
    ("mesh: mound.ply, unit: 1 mm", "1 mm", "", NEAR, "the camera is in the grains of materials[0]: mound.ply is 12 cm across"),
    ("mesh: mound.ply, unit: 1 um", "1 mm", "", FAR, "mound.ply is 120 um across, as one unit of it is 1 um; surfaces"),
    ("mesh: mound.ply, unit: 1 mm", "1 mm", "", FAR, None),
    ("mesh: mound.ply, unit: 1 mm", "1 mm", ", as: medium", NEAR, None),
    ("mesh: mound.ply, unit: 1 cm", "1 mm", "", (0.7, 0.0, 0.0), None),
])
def test_a_unit_that_does_not_fit_is_doubted(mound, where, unit, more, origin, said):
    """Sizes far apart and a camera among grains; not a camera in a medium, nor what is merely large."""
    sentences = meshes.doubts(mound(where, unit, more), around(origin))
    assert len(sentences) == (said is not None)
    if said:
        assert said in sentences[0] and "s.yaml:5: materials[0].where.mesh: " in sentences[0]


def test_warnings_are_remarks_once():
    lines = []
    with warned(lines.append):
        for _ in range(2):
            warnings.warn("a mesh of 120 m", stacklevel=1)
    assert lines == ["warning: a mesh of 120 m"]


@pytest.mark.parametrize("where, more, said", [
    ("shape: heap", "", "materials[0] is a body of the medium that stands for the grains of its asset: no grain is to be seen"),
    ("mesh: mound.ply", ", as: medium", "materials[0] is a medium of"), ("mesh: mound.ply", "", ""),
    ("shape: heap", ", method: surface", ""),
])
def test_grains_that_are_not_seen_are_told(mound, where, more, said):
    told = passes._hidden_grains(mound(where, more=more), [SimpleNamespace(stages=("grains", "packing", "medium"))])
    assert said in "".join(told) and bool(told) == bool(said)
    assert not passes._hidden_grains(mound("shape: heap"), [SimpleNamespace(stages=("medium",))])
