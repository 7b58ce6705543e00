"""Renders an exported material in Cycles.  Not for pytest: Blender's Python runs it, `python -P tests/blender_scene.py JOB.json`.

JOB: `material`, the exported script; `renders`, a list of `light` ("sun" with `angle`, "behind"), `bounces`, `samples`;
`output`, the JSON file that gets, for each of them, the linear colour of all pixels as `mean` and its standard `error`;
`picture`, if there is one, a PNG of a ball of the medium, `depth` m across, with a lamp behind it.

The slab is 1 m thick and 20 m wide, seen along its normal.  The sun (irradiance 1) shines at `angle` (rad) to the way to the
camera; "behind" is a white sky that only the camera sees.
"""

import json
import math
import runpy
import sys
import tempfile
from pathlib import Path

import bpy
import numpy as np
from mathutils import Vector

CORNERS = [(x, y, z) for x in (-10, 10) for y in (-10, 10) for z in (-0.5, 0.5)]
FACES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
SIZE = 8


def put(name, data, location=(0, 0, 0)):
    thing = bpy.data.objects.new(name, data)
    thing.location = location
    bpy.context.scene.collection.objects.link(thing)
    return thing


def begin(script, samples, bounces, size):
    """An empty scene for Cycles without whatever makes it cleverer or darker, and the exported material."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine, scene.render.resolution_x, scene.render.resolution_y = "CYCLES", size, size
    scene.cycles.samples = samples
    scene.cycles.use_denoising = scene.cycles.use_adaptive_sampling = False
    scene.cycles.sample_clamp_indirect, scene.cycles.pixel_filter_type = 0, "BOX"
    scene.view_settings.view_transform = "Standard"
    scene.render.threads_mode, scene.render.threads = "FIXED", 2
    scene.world = bpy.data.worlds.new("world")
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = 0, 0, 0, 1
    runpy.run_path(script)
    scene.cycles.volume_bounces, scene.cycles.max_bounces = bounces, max(bounces, 1)  # which the script raises
    (material,) = bpy.data.materials
    return scene, material


def camera(scene, kind, width, away):
    data = bpy.data.cameras.new("camera")
    data.type, data.ortho_scale, data.lens, data.sensor_width = kind, width, 50, 36
    scene.camera = put("camera", data, (0, 0, away))


def rendered(scene):
    """(N, 3) linear colours."""
    with tempfile.TemporaryDirectory() as folder:
        scene.render.image_settings.file_format, scene.render.image_settings.color_depth = "OPEN_EXR", "32"
        scene.render.filepath = str(Path(folder) / "out.exr")
        bpy.ops.render.render(write_still=True)
        image = bpy.data.images.load(scene.render.filepath)
        image.colorspace_settings.name = "Non-Color"
        return np.array(image.pixels[:]).reshape(-1, 4)[:, :3]


def slab(script, light, samples, bounces, angle=0.0):
    scene, material = begin(script, samples, bounces, SIZE)
    mesh = bpy.data.meshes.new("slab")
    mesh.from_pydata(CORNERS, [], FACES)
    mesh.materials.append(material)
    put("slab", mesh)
    camera(scene, "ORTHO", 0.5, 5)
    if light == "sun":
        sun = bpy.data.lights.new("sun", "SUN")
        sun.energy, sun.angle = 1, 0
        lamp = put("sun", sun)
        lamp.rotation_mode = "QUATERNION"
        lamp.rotation_quaternion = Vector((-math.sin(angle), 0, -math.cos(angle))).to_track_quat("Z", "Y")
    else:
        scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = 1, 1, 1, 1
        scene.world.cycles_visibility.scatter = False
    pixels = rendered(scene)
    return {"mean": pixels.mean(axis=0).tolist(), "error": (pixels.std(axis=0, ddof=1) / math.sqrt(len(pixels))).tolist()}


def picture(script, path, depth):
    """A ball, `depth` m across, before a lamp."""
    scene, material = begin(script, 256, 64, 256)
    bpy.ops.mesh.primitive_uv_sphere_add(segments=64, ring_count=32, radius=depth / 2)
    bpy.context.object.data.materials.append(material)
    camera(scene, "PERSP", 1, 3 * depth)
    lamp = bpy.data.lights.new("lamp", "POINT")
    lamp.energy, lamp.shadow_soft_size = 40 * depth**2, 0.04 * depth
    put("lamp", lamp, (0.15 * depth, 0.1 * depth, -1.5 * depth))
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = 0.02, 0.03, 0.05, 1
    scene.render.image_settings.file_format, scene.render.filepath = "PNG", path
    bpy.ops.render.render(write_still=True)


if __name__ == "__main__":
    job = json.loads(Path(sys.argv[1]).read_text())
    found = [slab(job["material"], **render) for render in job["renders"]]
    if "picture" in job:
        picture(job["material"], job["picture"], job["depth"])
    Path(job["output"]).write_text(json.dumps(found))
