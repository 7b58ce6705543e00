"""Small scenes that are hard on the rules of `renderers/*/requirements.py`: light exactly behind, a caustic, a thin shell, one
bright particle, a grazing beam, and others.  Lengths of fog and grains in m, of translucent bodies in mm.
"""

from typing import NamedTuple

import numpy as np

from bakery.physics.shapes.radial import icosphere
from bakery.store import ply


class Case(NamedTuple):
    """A scene that is written by `write`.

    Attributes
    ----------
    recipe : what stands below its wavelengths
    scene : its YAML below the name
    world : what stands in the Mitsuba file beside its sensor
    view : origin and target of the camera
    fov : degrees
    size : (height, width)
    samples : a pixel and seed
    block : pixels squared whose means count
    """

    recipe: str
    scene: str
    world: str
    view: tuple[str, str]
    fov: float = 40
    size: tuple[int, int] = (12, 16)
    samples: int = 4
    block: int = 1


def write(case: Case, folder):
    """Path of the scene; its recipe, meshes and Mitsuba file stand beside it."""
    head = "bakery: 1\nname: material\nwavelengths: [0.55]\ntolerance: 3%\nmeasure: integrated\n"
    (folder / "material.yaml").write_text(head + case.recipe)
    (folder / "scene.yaml").write_text(f"bakery_scene: 2\nname: picture\n{case.scene}")
    height, width = case.size
    sensor = f"""<integrator type="path"/><sensor type="perspective"><float name="fov" value="{case.fov}"/>
<transform name="to_world"><lookat origin="{case.view[0]}" target="{case.view[1]}" up="0, 0, 1"/></transform>
<film type="hdrfilm"><integer name="width" value="{width}"/><integer name="height" value="{height}"/><rfilter type="box"/></film>
</sensor>"""
    (folder / "world.xml").write_text(f'<scene version="3.0.0">{sensor}{case.world}</scene>')
    vertices, faces = icosphere(320)
    shell = np.concatenate([vertices, 0.9 * vertices]), np.concatenate([faces, faces[:, ::-1] + len(vertices)])
    layer = vertices * [1, 1, 0.05]
    for name, mesh in (("ball", (vertices, faces)), ("shell", shell), ("layer", (layer, faces))):
        (folder / f"{name}.ply").write_bytes(ply.mesh(*mesh, single=True))
    return folder / "scene.yaml"


def _lamp(place, target, size, radiance):
    """A rectangle that shines towards the target."""
    return f"""<shape type="rectangle"><transform name="to_world"><scale value="{size}"/>
<lookat origin="{place}" target="{target}" up="0.01, 0.02, 1"/></transform>
<bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf>
<emitter type="area"><rgb name="radiance" value="{radiance}"/></emitter></shape>"""


def _sun(direction):
    return f"""<emitter type="directional"><vector name="direction" value="{direction}"/>
<rgb name="irradiance" value="1"/></emitter>"""


def _sky(radiance):
    return f'<emitter type="constant"><rgb name="radiance" value="{radiance}"/></emitter>'


def _body(file, size):
    return f"""<shape type="ply" id="body"><string name="filename" value="{file}.ply"/><transform name="to_world">
<scale value="{size}"/></transform><bsdf type="null"/></shape>"""


_WALL = """<shape type="rectangle"><transform name="to_world"><scale value="40"/><lookat origin="0, 10, 0" target="0, 0, 0"
up="0, 0, 1"/></transform><bsdf type="diffuse"><rgb name="reflectance" value="0.3"/></bsdf></shape>"""
_SCREEN = _WALL.replace('"40"', '"1.4"').replace("0, 10, 0", "-0.6785, 2, 0").replace("0, 0, 0", "-0.6785, 0, 0")
_TABLE = """<shape type="rectangle"><transform name="to_world"><scale value="0.05"/><translate z="-0.01"/></transform>
<bsdf type="diffuse"><rgb name="reflectance" value="0.3"/></bsdf></shape>"""
_CAUSTIC = """<shape type="sphere"><transform name="to_world"><scale value="3"/><translate x="2" z="10"/></transform>
<bsdf type="dielectric"><float name="int_ior" value="1.5"/><float name="ext_ior" value="1"/></bsdf></shape>"""


def _medium(g, albedo, path, stage="multiple_scattering: {tolerance: 0.5%}"):
    return f"medium: {{albedo: {albedo}, mean_free_path: {path}, phase: {{type: hg, g: {g}}}}}\n{stage}\n"


def _fog(density, samples=64):
    return f"recipe: material.yaml\npicture: {{mitsuba: world.xml, samples: {samples}, far: 30 m}}\n" \
           f"fog: {{density: {density}}}\nfilter: {{outside: black, energy: lost}}\n"


_BODIES = "tolerance: 10%\nscene: {mitsuba: world.xml, unit: 1 mm}\n" \
          "materials:\n  - {where: {shape: body}, recipe: material.yaml, method: vrl+tables}\n"


def _drops(number, radius):
    return f"""particles:
  host: air
  number_density: {number} /m^3
  components: [{{name: drops, material: water, size: {{distribution: lognormal, radius: {radius} um, sigma: 1.4,
    min: {0.2 * radius:g} um, max: {4 * radius:g} um}}}}]
"""


def _particles(number, radius, box):
    return _drops(number, radius) + f"discrete: {{box: {box}}}\n"


_IN_AIR = "tolerance: 10%\nscene: {mitsuba: world.xml}\nmaterials: [{recipe: material.yaml}]\n"
_BEADS = """grains:
  radius: 0.5 mm
  components: [{name: bead, shape: {type: SHAPE}, surface: {type: dielectric, material: bk7},
    interior: {absorption: 0.2 /mm}}]
packing: {fraction: 0.6, count: 200}
effective_medium: {sigma_t: random_walk}
"""


def _grains(mesh, unit):
    return "tolerance: 10%\nscene: {mitsuba: world.xml}\n" \
           f"materials: [{{where: {{mesh: {mesh}.ply, unit: {unit}}}, recipe: material.yaml}}]\n"


_AHEAD = ("0, 0, 0", "0, 1, 0")
_AT_BALL = ("0, -19, 5", "0, 0, 0")
_INTO_BOX = ("0.2, -0.4, 0.2", "0.2, 0.2, 0.2")
_MEANS = (24, 32), 2, 4  # size, samples and block: tables choose beams, so that little noise is shared
_LONGER = (24, 32), 8, 4
_BIG = _lamp("3, 3, 13", "0, 0, 0", 8, 4)

CASES = {
    # ---- fog: the lamp fills a pixel
    "fog, light behind": Case(_medium(0.95, 0.95, "2 m", "beam: {}"), _fog("{type: uniform}"),
                              _WALL + _lamp("0, 9.9, 0", "0, 0, 0", 0.2, 400), _AHEAD, size=(31, 31)),
    "fog, grazing": Case(_medium(0.8, 0.9, "2 m", "beam: {}"), _fog("{type: height, scale: 4, base: -0.5 m, falloff: 0.1 m}"),
                         _WALL + _lamp("0, 9.9, -0.6", "0, 0, 0", 0.3, 100), _AHEAD, size=(31, 31)),
    "fog, a gap in the wall": Case(_medium(0.9, 0.9, "2 m", "beam: {}"), _fog("{type: uniform}"),
                                   _lamp("6.88, 19, 0", "6.88, 0, 0", 1.5, 40)
                                   + _SCREEN, _AHEAD, size=(300, 400)),
    "fog of droplets, light behind": Case(_drops(3e9, 5) + "beam: {}\n", _fog("{type: uniform}"),
                                          _WALL + _lamp("0, 9.9, 0", "0, 0, 0", 0.2, 400), _AHEAD, size=(31, 31)),
    # ---- translucent bodies
    "lamp behind a body": Case(_medium(0.8, 0.9, "2 mm"), _BODIES, _body("ball", 5) + _lamp("0, 12, -3.2", "0, 0, 0", 0.5, 400),
                               _AT_BALL, 34, *_MEANS),
    "thin shell": Case(_medium(0.8, 0.95, "1 mm"), _BODIES, _body("shell", 5) + _BIG, _AT_BALL, 34, *_LONGER),
    "lamp inside a shell": Case(_medium(0.8, 0.95, "0.2 mm"), _BODIES, _body("shell", 5)
                                + '<shape type="sphere"><float name="radius" value="1"/><emitter type="area">'
                                  '<rgb name="radiance" value="50"/></emitter></shape>', _AT_BALL, 34, *_MEANS),
    "caustic on a body": Case(_medium(0.8, 0.9, "1 mm"), _BODIES, _body("ball", 5) + _CAUSTIC
                              + _lamp("4, 0, 25", "2, 0, 8", 14, 6), _AT_BALL, 34, (24, 32), 4, 4),
    "body larger than tables": Case(_medium(0.8, 0.98, "0.045 mm"), _BODIES, _body("ball", 5) + _BIG, _AT_BALL, 34, *_LONGER),
    # ---- separate particles
    "one bright particle": Case(_particles(2000, 10, "[0.4 m, 0.4 m, 0.4 m]"), _IN_AIR,
                                '<emitter type="point"><point name="position" x="0.2" y="-0.4" z="0.6"/>'
                                  '<rgb name="intensity" value="4"/></emitter>', ("0.2, -0.05, 0.2", "0.2, 0.2, 0.2")),
    "beam towards the camera": Case(_particles(1e6, 10, "[0.4 m, 0.4 m, 0.4 m]"), _IN_AIR,
                                    _sun("0.12, -1, 0"), _INTO_BOX),
    "rainbow": Case(_particles(1e6, 10, "[0.4 m, 0.4 m, 0.4 m]"), _IN_AIR, _sun("0.66, 0.75, 0"), _INTO_BOX),
    # ---- grains
    "one grain": Case(_BEADS.replace("SHAPE", "sphere"), _grains("ball", "1.2 mm"), _TABLE + _sky(0.3)
                      + _lamp("0, 0.05, 0.02", "0, 0, 0", 0.01, 20), ("0, -0.004, 0.002", "0, 0, 0")),
    "distant heap": Case(_BEADS.replace("SHAPE", "box"), _grains("ball", "10 cm"), _sky(0.3)
                         + _lamp("2, -3, 4", "0, 0, 0", 1, 20), ("0, -5, 1", "0, 0, 0"), 3),
    "thin layer of grains": Case(_BEADS.replace("SHAPE", "box"), _grains("layer", "30 mm"), _TABLE.replace("0.05", "0.2")
                                 + _sky(0.3) + _lamp("0.05, 0, 0.2", "0, 0, 0", 0.05, 10), ("0, -0.1, 0.05", "0, 0, 0")),
}
