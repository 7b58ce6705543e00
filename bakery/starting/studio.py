"""A studio around somebody's mesh: floor, a window to the side, sky, and a camera that frames it."""

import math
import os
from pathlib import Path

import numpy as np

from bakery.draw.meshes import CREASE, smooth_normals
from bakery.errors import UsageError
from bakery.recipe import load
from bakery.recipe.starting import starts
from bakery.run import draft
from bakery.run.cache import Cache
from bakery.starting.materials import Filling, filling, of_recipe
from bakery.starting.meshes import Solid, length, solid
from bakery.store import ply

FIELD_OF_VIEW = 34.0  # degrees, both ways: the picture is square
_FILLED = 0.8  # share of the picture's edge that the mesh takes
_TOWARD_CAMERA = np.array([-0.28, -0.88, 0.44])  # from above by 25 degrees: the floor fills the picture
# from the side: shadows give shape; it is wide, as small lights are noise in glass and grains
_TOWARD_WINDOW = np.array([-0.88, -0.18, 0.44])
_WINDOW = 4.0, 2.6  # distance, and half of the edge, over the radius of the mesh
# radiance of the window, so that a white surface that faces it has radiance 1; and of the sky, which fills the shadows
_WINDOW_LIGHT, _SKY = (4.0, 3.8, 3.5), (0.10, 0.115, 0.135)
_FEW, _MANY = 300, 1e9  # grains


def in_studio(material: str | Path, mesh: Path, name: str, folder: Path, *, unit=None, height=None, up="z"):
    """A recipe and a scene of a mesh that a material fills.

    Parameters
    ----------
    material : one of `materials.FILLINGS`, or the file of a recipe, which stays as it is
    name : of the recipe, and of the picture;  folder : where the files will lie
    mesh, unit, height, up : as `meshes.solid` takes them

    Returns
    -------
    files : name of a file -> content: the recipe NAME.yaml and its tables, NAME.scene.yaml, .xml and .ply
    remarks : what was taken for granted

    Raises UsageError : there is no such material, or the mesh cannot be filled with it
    """
    fill = of_recipe(material) if isinstance(material, Path) else filling(material)
    body = solid(mesh, fill.height, unit, height, up)
    if isinstance(material, Path):
        path, files, written = material, {}, Path(os.path.relpath(material.resolve(), folder.resolve())).as_posix()
    else:
        source, written = starts()[fill.recipe], f"{name}.yaml"
        path, files = source.path, source.files(name)
    recipe = load(path)
    gap, *about = _grains(body, mesh, recipe) if fill.index is None and recipe.grains is not None else _body(fill, body, recipe)
    scale, inside = (1e3, "1 mm") if body.extent.max() < 1 else (1.0, "1 m")
    entry = f"{{where: {{shape: body}}, recipe: {written}, boundary: {{index: {fill.index:g}}}}}" if fill.index else \
        f"{{where: {{mesh: {name}.scene.ply, unit: {inside}}}, recipe: {written}}}"
    remarks = [f"{mesh.name}: {body.size}", f"{up} of the file points up (change it with --up)", *about]
    files[f"{name}.scene.yaml"] = _scene(name, material, mesh, inside, entry, remarks)
    files[f"{name}.scene.xml"] = _surroundings(name, body, scale, fill, gap)
    files[f"{name}.scene.ply"] = _mesh(scale * body.vertices, body.faces, inside.split()[1])
    return files, remarks


def _mesh(vertices, faces, unit) -> bytes:
    """A PLY file with normals, and a vertex on each side of sharp edges: where a file has none Mitsuba takes means over all faces
    around a vertex, and a slab's are 55 degrees off: light leaves it where it should not, or is lost."""
    normals = np.round(smooth_normals(vertices, faces, CREASE), 6).reshape(-1, 3) + 0.0  # the same to the last bit, -0 too
    rows, corners = np.unique(np.concatenate([vertices[faces.ravel()], normals], axis=1), axis=0, return_inverse=True)
    return ply.mesh(rows[:, :3], corners.reshape(-1, 3), [f"unit: {unit}"], single=True, normals=rows[:, 3:])


def _body(fill, body, recipe):
    """How far above the floor a body stands, m, and remarks."""
    path = _mean_free_path(recipe)
    across = float(body.extent.min())
    thin = [] if across > 3 * path else [f"light of some colour goes {length(path)} until it is scattered or absorbed, and the "
                                         f"mesh is {length(across)} across: one sees through it, less with a larger --height"]
    gap = 2e-3 * float(body.extent.max())
    if fill.index is None:
        return gap, "without a surface, as it floats in air", *thin
    surface = f"roughness {fill.roughness:g}" if fill.roughness else "smooth"
    assumed = recipe.particles is None and isinstance(fill.recipe, Path)
    why = ", ASSUMED, as coefficients do not tell (boundary.index of the scene, and int_ior of its .xml, change it)" * assumed
    return gap, f"refractive index {fill.index:.4g} against air, {surface}{why}", *thin


def _mean_free_path(recipe) -> float:
    """m, the longest of all wavelengths."""
    medium = recipe.medium
    if medium is None:
        return 1 / float(np.min(draft.medium(recipe, {}, Cache()).sigma_t))
    if medium.mean_free_path is not None:
        return 1e-6 * float(np.max(medium.mean_free_path))
    return 1 / float(np.min(np.add(medium.sigma_s, medium.sigma_a)))


def _grains(body, mesh, recipe):
    """How far above the floor the mesh of grains stands, which stick out of it by a radius, m, and a remark."""
    radius, fraction = 1e-6 * float(recipe.grains.radius), float(recipe.packing.fraction[0])
    count = body.volume * fraction / (4 / 3 * math.pi * radius**3)
    if count < 1 or body.extent.min() < 2 * radius:
        raise UsageError(f"{mesh}: found a mesh {length(float(body.extent.min()))} across at its narrowest, and grains are "
                         f"{length(2 * radius)} wide; use a larger --height, or a smaller radius in a recipe of your own")
    remark = f"some {_rounded(count)} grains, {length(2 * radius)} wide as in the recipe"
    if count < _FEW:
        remark += "; so few keep little of the mesh's shape: a larger --height has more"
    elif count > _MANY:
        remark += "; so many that single ones are not seen: a smaller --height shows them"
    return radius, remark


def _rounded(count: float) -> str:
    """`46,000`, `210 million`: two digits."""
    digits = float(f"{count:.2g}")
    return f"{digits:,.0f}" if digits < 1e6 else f"{round(digits / 1e6, 1):,} million".replace(".0 ", " ")


def _scene(name, material, mesh, unit, entry, remarks) -> str:
    facts = "\n".join(f"# - {remark}" for remark in remarks)
    material = material.stem if isinstance(material, Path) else material
    return f"""# {material.replace("_", " ").capitalize()} in the shape of {mesh.name}, on a floor beside a window.
{facts}
bakery_scene: 2
name: {name}
# Surfaces, light and camera; the mesh stands in its own file, {name}.scene.ply, its foot in the origin, z up.
scene: {{mitsuba: {name}.scene.xml, unit: {unit}}}
# Size in pixels.
film: {{width: 512, height: 512}}
# No pass is begun after this time.  In its place, or besides: noise: 2%.
stop: {{time: 60 s}}
materials:
  - {entry}
# How the PNG shows the light: exposure, a factor.  The EXR is linear.
display: {{exposure: 1.3}}
"""


def _surroundings(name, body: Solid, scale: float, fill: Filling, gap: float) -> str:
    vertices, extent = scale * body.vertices, scale * body.extent
    middle = np.array([0, 0, extent[2] / 2])
    radius = float(np.linalg.norm(vertices - middle, axis=1).max())
    camera = _framing(vertices, middle)
    window = middle + _WINDOW[0] * radius * _TOWARD_WINDOW / np.linalg.norm(_TOWARD_WINDOW)
    boundary = "" if not fill.index else f"""
<shape type="ply" id="body"> <string name="filename" value="{name}.scene.ply"/> {_bsdf(fill)} </shape>"""
    return f"""<!-- A floor, a window and a sky around a mesh; z is up.  Lengths in the unit that the scene says. -->
<scene version="3.0.0">
<integrator type="path"/>
<sensor type="perspective">
    <float name="fov" value="{FIELD_OF_VIEW:g}"/> <string name="fov_axis" value="x"/>
    <transform name="to_world"> <lookat origin="{_triple(camera)}" target="{_triple(middle)}" up="0, 0, 1"/> </transform>
    <film type="hdrfilm"> <integer name="width" value="512"/> <integer name="height" value="512"/> </film>
</sensor>{boundary}
<shape type="rectangle" id="floor"> <transform name="to_world"> <scale value="{60 * radius:.4g}"/> \
<translate z="{-scale * gap:.4g}"/> </transform>
    <bsdf type="twosided"> <bsdf type="diffuse"> <rgb name="reflectance" value="{_triple(fill.floor)}"/> </bsdf> </bsdf> </shape>
<shape type="rectangle" id="window"> <transform name="to_world"> <scale value="{_WINDOW[1] * radius:.4g}"/> \
<lookat origin="{_triple(window)}" target="{_triple(middle)}" up="0, 0.01, 1"/> </transform>
    <emitter type="area"> <rgb name="radiance" value="{_triple(_WINDOW_LIGHT)}"/> </emitter> </shape>
<emitter type="constant" id="sky"> <rgb name="radiance" value="{_triple(_SKY)}"/> </emitter>
</scene>
"""


def _bsdf(fill: Filling) -> str:
    indices = f'<float name="int_ior" value="{fill.index:g}"/> <float name="ext_ior" value="1"/>'
    if not fill.roughness:
        return f'<bsdf type="dielectric"> {indices} </bsdf>'
    return (f'<bsdf type="roughdielectric"> {indices} <string name="distribution" value="ggx"/> '
            f'<float name="alpha" value="{fill.roughness:g}"/> </bsdf>')


def _framing(vertices, target):
    """Where a camera stands that looks at a target (3,) and sees all vertices (V, 3) in the middle of its picture."""
    back = _TOWARD_CAMERA / np.linalg.norm(_TOWARD_CAMERA)
    right = np.cross([0, 0, 1.0], back)
    right /= np.linalg.norm(right)
    seen = (vertices - target) @ np.array([right, np.cross(back, right), back]).T
    slope = _FILLED * math.tan(math.radians(FIELD_OF_VIEW / 2))
    return target + back * float((np.abs(seen[:, :2]).max(axis=1) / slope + seen[:, 2]).max())


def _triple(values) -> str:
    return ", ".join(f"{value:.5g}" for value in values)
