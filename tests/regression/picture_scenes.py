"""Scenes whose pictures are kept in `pictures.json`: those of assets/scenes, and small ones that are written here.

A small scene is what stands around (XML of Mitsuba), a camera, and materials: a kind, a recipe, where it is, and further keys of
its entry.  `Small.write` makes the files of it.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from bakery.physics.shapes.radial import icosphere
from bakery.store import ply
from renderers.scene.common import FORMAT

SIDE = 48  # pixels along a side of a small scene's film

# ---- recipes


def medium(albedo, free_path, g) -> str:
    """A recipe of a body's material: albedo and mean free paths (mm) of three wavelengths."""
    return f"""wavelengths: rgb
tolerance: 5%
medium: {{albedo: {list(albedo)}, mean_free_path: "{list(free_path)} mm", phase: {{type: hg, g: {g}}}}}
multiple_scattering: {{sources: [point, segment]}}
"""


def drops(material, method="stored", number="8e5") -> str:
    """Spheres of 1 mm in a box of 20 cm: optical depth about 1."""
    return f"""wavelengths: rgb
tolerance: 10%
measure: integrated
particles:
  host: air
  number_density: {number} /m^3
  components: [{{name: beads, material: {material}, size: {{distribution: single, radius: 1 mm}}}}]
discrete: {{box: [20 cm, 20 cm, 20 cm], method: {method}}}
"""


def grains(surface, interior="") -> str:
    """Balls of 0.5 mm."""
    return f"""wavelengths: rgb
tolerance: 5%
grains:
  radius: 0.5 mm
  components: [{{name: ball, shape: {{type: sphere}}, surface: {surface}{interior and f', interior: {interior}'}}}]
packing: {{fraction: 0.5, count: 100}}
effective_medium: {{sigma_t: random_walk, walks: 4000}}
"""


WAX = medium((0.98, 0.95, 0.8), (1.0, 0.8, 0.6), 0.5)
CLOUDY = medium((0.99, 0.99, 0.98), (0.7, 0.6, 0.5), 0.0)
BEADS, SEEDS = drops("{n: 1.5}"), drops("{n: 1.5}", "procedural")
SOOTY = drops("{n: 1.5, k: 2e-5}")
CLEAR = grains("{type: dielectric, material: {n: 1.5}}")
GREY = grains("{type: dielectric, material: {n: 1.5}}", "{absorption: 0.5 /mm}")
METAL = grains("{type: conductor, material: copper, roughness: 0.05}")
ROUGH = grains("{type: dielectric, material: {n: 1.5}, roughness: 0.3}")
CHALK = grains("{type: diffuse, reflectance: 0.8}")

# ---- what stands around; lengths in units of the file

SKY = '<emitter type="constant" id="sky"><rgb name="radiance" value="0.3 0.35 0.4"/></emitter>'
POINT = '<emitter type="point" id="lamp"><point name="position" {place}/><rgb name="intensity" value="{power}"/></emitter>'
SUN = ('<emitter type="directional" id="sun"><vector name="direction" x="-0.5" y="0.4" z="-0.8"/>'
       '<rgb name="irradiance" value="3 2.8 2.5"/></emitter>')
ENVIRONMENT = ('<emitter type="envmap" id="surroundings"><string name="filename" value="surroundings.exr"/></emitter>')
NULL = '<bsdf type="null"/>'


def floor(side) -> str:
    """A table at z = -side / 10 of a side, below what stands at 0."""
    return (f'<shape type="rectangle" id="floor"><transform name="to_world"><scale value="{3 * side}"/></transform>'
            '<bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="0.5 0.4 0.3"/></bsdf></bsdf></shape>')


def panel(side) -> str:
    """A lamp as large as what it shines on, above it to the right."""
    return (f'<shape type="rectangle" id="panel"><transform name="to_world"><scale value="{side / 2}"/><lookat '
            f'origin="{1.2 * side} {-side} {2 * side}" target="0 0 {side / 2}" up="0 0.01 1"/></transform><emitter type="area">'
            '<rgb name="radiance" value="12 11 9"/></emitter></shape>')


def glass(inside, outside=1.0, alpha=None) -> str:
    """A boundary that refracts, rough where `alpha` is given."""
    rough = "" if alpha is None else f'<float name="alpha" value="{alpha}"/>'
    return (f'<bsdf type="{"dielectric" if alpha is None else "roughdielectric"}"><float name="int_ior" value="{inside}"/>'
            f'<float name="ext_ior" value="{outside}"/>{rough}</bsdf>')


def shape(name, inner) -> str:
    return f'<shape type="ply" id="{name}"><string name="filename" value="{name}.ply"/>{inner}</shape>'


# ---- meshes


def ball(radius, height, triangles=320):
    """A ball whose middle is so high."""
    vertices, faces = icosphere(triangles)
    return radius * vertices + [0, 0, height], faces


def box(low, high):
    sides = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    faces = np.array([[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6],
                      [0, 6, 4], [1, 5, 7], [1, 7, 3]])
    return np.array(low) + sides * (np.array(high) - np.array(low)), faces


# ---- scenes


class Material(NamedTuple):
    """kind : `body`, `particles` or `grains`;  recipe : its text, without head;  where, more : keys of the entry, YAML text"""

    kind: str
    recipe: str
    where: str
    more: Mapping[str, str] = {}


class Small(NamedTuple):
    """around : XML between the tags of the scene;  meshes, grids : files by name;  camera : origin and target, in units;
    unit : of the Mitsuba file;  methods : of which pictures are kept"""

    materials: tuple[Material, ...]
    around: str
    methods: tuple[str, ...]
    camera: tuple = ((0, -18, 6), (0, 0, 3))
    meshes: Mapping[str, tuple] = {}
    grids: Mapping[str, np.ndarray] = {}
    unit: str = "1 mm"
    fov: float = 30

    def write(self, folder: Path) -> Path:
        """The scene's files in a folder; its path."""
        folder.mkdir(parents=True, exist_ok=True)
        for name, mesh in self.meshes.items():
            (folder / f"{name}.ply").write_bytes(ply.mesh(*mesh))
        for name, values in self.grids.items():
            np.save(folder / f"{name}.npy", values.astype(np.float32))
        if ENVIRONMENT in self.around:
            _surroundings(folder / "surroundings.exr")
        origin, target = (", ".join(map(str, point)) for point in self.camera)
        sensor = (f'<sensor type="perspective"><float name="fov" value="{self.fov}"/><transform name="to_world"><lookat '
                  f'origin="{origin}" target="{target}" up="0, 0, 1"/></transform><film type="hdrfilm"><integer name="width" '
                  f'value="{SIDE}"/><integer name="height" value="{SIDE}"/></film></sensor>')
        (folder / "scene.xml").write_text(f'<scene version="3.0.0"><integrator type="path"/>{sensor}{self.around}</scene>')
        for number, material in enumerate(self.materials):
            (folder / f"material_{number}.yaml").write_text(f"bakery: 1\nname: material_{number}\n{material.recipe}")
        path = folder / "scene.yaml"
        path.write_text(f"bakery_scene: {FORMAT}\nname: scene\ntolerance: 10%\nscene: {{mitsuba: scene.xml, unit: {self.unit}}}\n"
                        + _text(self.materials))
        return path


def _text(materials) -> str:
    """The materials of a scene in YAML."""
    entries = [{"where": material.where, "recipe": f"material_{number}.yaml"} | dict(material.more)
               for number, material in enumerate(materials)]
    return "materials:\n" + "".join(f"  - {_flow(entry)}\n" for entry in entries)


def _flow(entry) -> str:
    return "{" + ", ".join(f"{key}: {value}" for key, value in entry.items()) + "}"


def _surroundings(path):
    """A sky that is brighter towards one side, and a small bright patch in it."""
    from renderers.mitsuba import bitmaps

    rows, columns = np.mgrid[0:16, 0:32]
    image = 0.1 + 0.4 * (1 - rows / 15)[..., None] * (0.5 + 0.5 * np.cos(columns / 16 * np.pi))[..., None] * [1.0, 0.9, 0.8]
    image[4:6, 20:23] = [9.0, 8.0, 6.0]
    bitmaps.library().Bitmap(image.astype(np.float32)).write(str(path))


def body(shape_name, recipe, **more) -> Material:
    return Material("body", recipe, f"{{shape: {shape_name}}}", more)


def _bodies() -> dict[str, Small]:
    def scene(around, *materials, methods, **more):
        return Small(materials, around, methods, **more)

    matched, refracting = shape("body", NULL), shape("body", glass(1.4))
    one, lit = {"body": ball(3, 3.1)}, floor(6) + panel(6) + SKY
    lamp = ('<emitter type="area"><rgb name="radiance" value="60 55 40"/></emitter>'
            '<bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf>')
    neighbours = {"left": box((-3, -1.5, 0.1), (0, 1.5, 4)), "right": box((0, -1.5, 0.1), (3, 1.5, 3))}
    inner = {"pane": ball(4, 4.1), "body": ball(3, 4.1)}
    return {
        "matched_ball": scene(matched + lit, body("body", WAX), meshes=one, methods=("paths", "shells", "vrl", "vrl+tables")),
        "glass_ball": scene(refracting + lit, body("body", WAX), meshes=one,
                            methods=("paths", "shells", "vrl", "vrl+tables", "beams+tables")),
        "rough_ball": scene(shape("body", glass(1.4, alpha=0.3)) + lit, body("body", WAX), meshes=one,
                            methods=("paths", "vrl+tables")),
        "touching_matched": scene(shape("left", NULL) + shape("right", NULL) + lit, body("left", WAX), body("right", CLOUDY),
                                  meshes=neighbours, methods=("paths", "shells", "vrl+tables")),
        "touching_glass": scene(shape("left", glass(1.4)) + shape("right", NULL) + lit, body("left", WAX), body("right", CLOUDY),
                                meshes=neighbours, methods=("paths", "shells")),
        "body_in_body": scene(shape("pane", NULL) + shape("body", glass(1.3)) + lit, body("pane", CLOUDY), body("body", WAX),
                              meshes=inner, methods=("paths", "shells")),
        "body_in_glass": scene(shape("pane", glass(1.5)) + shape("body", glass(1.35, 1.5)) + lit, body("body", WAX), meshes=inner,
                               methods=("paths", "vrl+tables")),
        "camera_inside": scene(matched + lit, body("body", WAX), meshes=one, camera=((0, -1, 3), (0, 3, 3.2)), fov=70,
                               methods=("paths", "shells")),
        "camera_inside_glass": scene(refracting + lit, body("body", WAX), meshes=one, camera=((0, -1, 3), (0, 3, 3.2)), fov=70,
                                     methods=("paths",)),
        "lamp_inside": scene(refracting + shape("lamp", lamp) + floor(6), body("body", WAX),
                             meshes=one | {"lamp": ball(0.7, 3.1, 80)}, methods=("paths", "vrl+tables")),
        "point_through_glass": scene(refracting + floor(6) + POINT.format(place='x="6" y="-6" z="9"', power="300 280 250"),
                                     body("body", WAX), meshes=one, methods=("paths", "vrl+tables", "beams+tables")),
        "point_on_matched": scene(matched + floor(6) + POINT.format(place='x="6" y="-6" z="9"', power="300 280 250"),
                                  body("body", WAX), meshes=one, methods=("paths", "vrl+tables")),
        "sun_on_bodies": scene(matched + floor(6) + SUN, body("body", CLOUDY), meshes=one, methods=("paths", "vrl+tables")),
        "surroundings_glass": scene(refracting + floor(6) + ENVIRONMENT, body("body", WAX), meshes=one, methods=("paths",)),
    }


def _particles() -> dict[str, Small]:
    whole = "{box: {lo: [-10, -10, 0] cm, hi: [10, 10, 20] cm}}"
    lit = floor(20) + panel(20) + SKY
    cloud = np.random.default_rng(3).random((5, 4, 6))

    def scene(around, recipe, where=whole, methods=("particles", "continuous"), *, camera=((0, -60, 25), (0, 0, 9)), files=(),
              fov=30, **more):
        meshes, grids = files or ({}, {})
        return Small((Material("particles", recipe, where, more),), around, methods, camera=camera, meshes=meshes, grids=grids,
                     unit="1 cm", fov=fov)

    return {
        "beads_stored": scene(lit, BEADS, methods=("particles", "continuous", "explicit", "query")),
        "beads_absorbing": scene(lit, SOOTY),
        "beads_moving": scene(lit, BEADS, velocity="[0.3, 0, -0.1] m/s", time="0.2 s"),
        "beads_in_mesh": scene(lit, SEEDS, "{mesh: cloud.ply, unit: 1 cm}", files=({"cloud": ball(9, 10)}, {})),
        "beads_in_grid": scene(lit, SEEDS, "{grid: cloud.npy, lo: [-10, -10, 0] cm, hi: [10, 10, 20] cm}",
                               files=({}, {"cloud": cloud})),
        "beads_point": scene(floor(20) + POINT.format(place='x="25" y="-25" z="30"', power="3000 2800 2500"), BEADS),
        "beads_sun": scene(floor(20) + SUN, BEADS, peak="keep"),
        "beads_inside": scene(floor(20) + ENVIRONMENT, SEEDS, camera=((0, -5, 10), (0, 10, 10)), fov=60),
    }


def _grains() -> dict[str, Small]:
    heap, lit = {"heap": ball(5, 5)}, floor(10) + panel(10) + SKY
    seen = (0, -32, 12), (0, 0, 4.5)

    def scene(around, *materials, methods=("ept", "vpt"), meshes=heap, grids=(), camera=seen):
        return Small(materials, around, methods, camera=camera, meshes=meshes, grids=dict(grids))

    def filled(recipe, mesh="heap", **more):
        return Material("grains", recipe, f"{{mesh: {mesh}.ply, unit: 1 mm}}", more)

    density = np.linspace(0.05, 0.5, 5).reshape(1, 1, 5)
    return {
        "grains_clear": scene(lit, filled(CLEAR), methods=("ept", "vpt", "ept+vpt", "ept+vpt+da", "teleport")),
        "grains_grey": scene(lit, filled(GREY)),
        "grains_metal": scene(floor(10) + SUN + SKY, filled(METAL)),
        "grains_rough": scene(floor(10) + POINT.format(place='x="12" y="-12" z="18"', power="900 850 800"), filled(ROUGH)),
        "grains_two": scene(lit, filled(CLEAR, "left"), filled(CHALK, "right"),
                            meshes={"left": box((-4, -3, 0), (0, 3, 4)), "right": box((0, -3, 0), (4, 3, 3))}),
        "grains_thinned": scene(floor(10) + ENVIRONMENT,
                                filled(CLEAR, fraction="{grid: density.npy, lo: [-6, -6, -1] mm, hi: [6, 6, 11] mm}"),
                                grids={"density": density}),
        "grains_around_camera": scene(lit, filled(ROUGH), camera=((0, -4, 9.3), (0, 0, 4.5))),
    }


SMALL = _bodies() | _particles() | _grains()
