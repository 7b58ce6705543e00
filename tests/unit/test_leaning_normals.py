"""Boundaries that refract by normals which are means over sharp edges are told."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh

from renderers.materials.bodies import methods
from renderers.mitsuba.shapes import Shape, leaning


def shape(mesh, normals):
    return Shape("it", np.asarray(mesh.vertices), np.asarray(mesh.faces), np.asarray(mesh.bounds), 1.5, True, normals)


def test_the_share_that_leans():
    """Of a cube with means over its edges: all of it, by acos(1/sqrt(3)) = 54.7 degrees.  Of a column with the normals of its
    ends everywhere: its sides."""
    cube = trimesh.creation.box()
    means = np.sign(cube.vertices) / math.sqrt(3)
    assert leaning(shape(cube, means), math.radians(54.0)) == pytest.approx(1)
    assert leaning(shape(cube, means), math.radians(55.5)) == leaning(shape(cube, None), 0.1) == 0
    cube.vertices *= [1, 1, 9]  # sides of 4 x 9, ends of 1 each
    of_ends = np.array([[0, 0, np.sign(z)] for z in cube.vertices[:, 2]])
    assert leaning(shape(cube, of_ends), math.radians(40)) == pytest.approx(36 / 38)


@pytest.mark.parametrize("matched, normals, told", [(False, True, True), (True, True, False), (False, False, False)])
def test_it_is_told_of_boundaries_that_refract(matched, normals, told):
    cube = trimesh.creation.box()
    world = SimpleNamespace(shapes=lambda: [shape(cube, np.sign(cube.vertices) / math.sqrt(3) if normals else None)])
    said = methods._leaning(world, [SimpleNamespace(name="it", matched=matched)])
    assert len(said) == told and all("100 % of it lean by more than 40 degrees" in sentence for sentence in said)
