"""Normals at the vertices of meshes, as scenes are loaded."""

import numpy as np
import pytest
import trimesh

from renderers.mitsuba.scene import load

import mitsuba as mi  # isort: skip  behind renderers.mitsuba, which finds LLVM

PLY = '<scene version="3.0.0"><shape type="ply"><string name="filename" value="mesh.ply"/></shape></scene>'


def loaded(folder, vertices, faces, normals=None):
    """Vertex normals (V, 3) of a mesh file in a scene."""
    mesh = trimesh.Trimesh(vertices, faces, process=False, vertex_normals=normals)
    (folder / "mesh.ply").write_bytes(trimesh.exchange.ply.export_ply(mesh, vertex_normal=normals is not None))
    (folder / "scene.xml").write_text(PLY)
    scene, *_ = load(folder / "scene.xml", sensor=False, integrator=False)
    (shape,) = scene.shapes()
    return np.array(mi.traverse(shape)["vertex_normals"]).reshape(-1, 3)


@pytest.fixture(scope="module")
def ball():
    """Faces around a vertex are far from each other in the list, so that several threads meet there."""
    mesh = trimesh.creation.icosphere(subdivisions=6)
    return mesh.vertices, np.random.default_rng(1).permutation(mesh.faces)


def test_they_are_the_same_each_time(ball, tmp_path):
    normals = [loaded(tmp_path, *ball) for _ in range(3)]
    assert np.allclose(normals[0], ball[0], atol=1e-3)
    assert all(np.array_equal(normals[0], others) for others in normals[1:])


def test_those_of_a_file_stay(ball, tmp_path):
    up = np.tile([0.0, 0.6, 0.8], (len(ball[0]), 1))
    assert np.array_equal(loaded(tmp_path, *ball, normals=up), up.astype(np.float32))


def test_what_mitsuba_warns_of_goes_to_standard_error(tmp_path, capfd):
    text = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    text += "element face 1\nproperty list uchar int vertex_indices\nproperty float stl\nend_header\n"
    (tmp_path / "part [1] of 2.ply").write_text(text + "0 0 0\n1 0 0\n0 1 0\n3 0 1 2 7\n")
    (tmp_path / "scene.xml").write_text(PLY.replace("mesh.ply", "part [1] of 2.ply"))
    appenders = mi.logger().appender_count()
    load(tmp_path / "scene.xml", sensor=False, integrator=False)
    out, messages = capfd.readouterr()
    assert out == "" and messages.startswith('Mitsuba: "part [1] of 2.ply": ') and 'attribute "stl" ignored' in messages
    assert mi.logger().appender_count() == appenders
