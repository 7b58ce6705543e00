"""Writes the scenes of translucent bodies: python assets/scenes/translucent.py     (needs manifold3d, of the extra `test`)

Meshes, Mitsuba files and scene files.  Lengths in mm, z up, the camera looks along y.  All meshes are closed, edges are rounded
and vertices have no normals of their own, so Mitsuba shades them smoothly.  A body is a shape with an id whose BSDF is its
boundary: `dielectric`, `roughdielectric`, or `null` where its index is matched; its medium is the asset in
the scene file.

`bumpy_ball` and `candle` have the media, boundaries and kinds of light of two scenes of Wang, Ge & Holzschuch, IEEE Trans. Vis.
Comput. Graph. (2018): a point for one, an area for the other.  Shapes, sizes and places are ours: its text has none.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1]))

import numpy as np  # noqa: E402
from manifold3d import CrossSection, FillRule, JoinType, Manifold  # noqa: E402

from bakery.store import ply  # noqa: E402

# ---- meshes


def turned(outline, sides=96):
    """A cross section of radii and heights, turned about the axis z."""
    return Manifold.revolve(outline, sides)


def rounded(polygon, radius):
    """A polygon whose corners are arcs, those inside too."""
    solid = CrossSection([polygon], FillRule.EvenOdd)
    for by in (-radius, 2 * radius, -radius):
        solid = solid.offset(by, JoinType.Round, circular_segments=32)
    return solid


def mirrored(half):
    """A polygon from its half of radii >= 0: both halves, so that rounding leaves the axis alone."""
    return half + [(-r, z) for r, z in half[::-1] if r > 0]


def divided(contour, step=5.0):
    """With a vertex at most every `step` along sides, but for the axis."""
    points = []
    for a, b in zip(contour, np.roll(contour, -1, axis=0)):
        count = max(1, math.ceil(np.hypot(*(b - a)) / step)) if a[0] or b[0] else 1
        points += [a + (b - a) * k / count for k in range(count)]
    return points


def right_half(outline):
    """What has radii >= 0; where it nearly meets the axis, on the axis: a vertex there, not a tiny ring."""
    half = outline ^ CrossSection.square((1000, 2000)).translate((0, -1000))
    half = half.warp(lambda point: (0 if point[0] < 0.1 else point[0], point[1])).simplify(0.01)
    return CrossSection([divided(contour) for contour in half.to_polygons()], FillRule.EvenOdd)


def lathe(half, radius, sides=96):
    """A solid of revolution with rounded edges, from half of its outline."""
    return turned(right_half(rounded(mirrored(half), radius)), sides)


def bumpy_ball(radius=36.5, height=3.6, bumps=56):
    """A ball with round bumps at the points of a Fibonacci spiral."""
    k = np.arange(bumps) + 0.5
    z, turn = 1 - 2 * k / bumps, math.pi * (1 + 5**0.5) * k
    ring = np.sqrt(1 - z * z)
    middle = np.stack([ring * np.cos(turn), ring * np.sin(turn), z], 1)

    def bumped(place):
        way = np.asarray(place) / np.linalg.norm(place, axis=1, keepdims=True)
        bump = np.exp((way @ middle.T - 1) / 0.019).sum(1, keepdims=True)
        return way * (radius + height * bump)

    return Manifold.sphere(1.0, 156).warp_batch(bumped).translate((0, 0, radius + height))


# a pillar of wax with a hollow that the flame has molten; radius and height of the outline
CANDLE = [(0, 0), (20, 0), (20, 60), (17.5, 61.5), (15, 57), (8, 54.5), (0, 54)]
SHELL = 1.9  # mm, 3 mean free paths of the wax


def candle(hollow=False):
    outline = rounded(mirrored(CANDLE), 1.2)
    if hollow:
        outline -= outline.offset(-SHELL, JoinType.Round, circular_segments=32)

    def worn(place):
        """A rim that is not level and sides that are not quite round."""
        x, y, z = np.asarray(place).T
        angle, high = np.arctan2(y, x), np.clip(z / 60, 0, 1) ** 3
        wider = 1 + 0.015 * np.sin(3 * angle + 0.08 * z) * np.clip(z / 10, 0, 1)
        return np.stack([x * wider, y * wider, z + high * (1.3 * np.sin(2 * angle + 0.6) + 0.7 * np.sin(5 * angle))], 1)

    return turned(right_half(outline)).warp_batch(worn)


# inside of the glass, its wall, its bottom, its height; height of the milk above the bottom, and the film of glass over the milk
INSIDE, WALL, BOTTOM, TALL, MILK, FILM = 26.0, 2.0, 7.0, 84.0, 58.0, 0.3
RISE, CAPILLARY = 1.8, 1.6  # mm, of the milk at the wall, and the length over which that falls to 1/e


def meniscus(level, reach):
    """What stands above a level at the wall, out to a radius `reach`: both halves of its outline."""
    r = INSIDE - np.linspace(9, 0, 28)
    curve = list(zip(r, level + RISE * np.exp((r - INSIDE) / CAPILLARY)))
    half = [(r[0], level - 1), (reach, level - 1), (reach, curve[-1][1]), *curve[::-1]]
    return CrossSection([half, [(-r, z) for r, z in half]], FillRule.EvenOdd)


def filled(half, radius, level, reach):
    """A solid of revolution with rounded edges, and a meniscus on its inner level."""
    return turned(right_half(rounded(mirrored(half), radius) + meniscus(level, reach)))


def tumbler():
    """The glass, solid where the milk is: milk is a body inside of it, so that each of its points has glass outside."""
    out, level = INSIDE + WALL, BOTTOM + MILK + FILM
    outline = [(0, 0), (out - 3, 0), (out, 3), (out, TALL), (INSIDE, TALL), (INSIDE, level), (0, level)]
    return filled(outline, 0.9, level, INSIDE + 1)


def milk():
    level = BOTTOM + MILK
    return filled([(0, BOTTOM), (INSIDE - 3, BOTTOM), (INSIDE, BOTTOM + 3), (INSIDE, level), (0, level)], 0.8, level, INSIDE)


def _ellipsoid(place, centre, axes, turn=0.0):
    """About the distance to an ellipsoid that is turned about the x axis, negative inside."""
    x, y, z = (a - b for a, b in zip(place, centre))
    if turn:
        y, z = y * math.cos(turn) + z * math.sin(turn), z * math.cos(turn) - y * math.sin(turn)
    first = math.sqrt(sum((a / b) ** 2 for a, b in zip((x, y, z), axes)))
    second = math.sqrt(sum((a / b**2) ** 2 for a, b in zip((x, y, z), axes)))
    return first * (first - 1) / max(second, 1e-9)


def _capsule(place, a, b, start, end):
    """Distance to a rod from a to b with round ends, whose radius goes from `start` to `end`."""
    along = [q - p for p, q in zip(a, b)]
    t = min(1.0, max(0.0, sum((c - p) * d for c, p, d in zip(place, a, along)) / sum(d * d for d in along)))
    return math.dist(place, [p + t * d for p, d in zip(a, along)]) - start - t * (end - start)


def _union(a, b, width):
    """Smooth: the two blend where they differ by less than `width`."""
    share = max(width - abs(a - b), 0) / width
    return min(a, b) - share * share * width / 4


def _without(a, b, width):
    return -_union(-a, b, width)


def _head(*place):
    """Distance to a head that looks along -y, on a round plinth; the right half, mirrored."""
    x, y, z = abs(place[0]), place[1], place[2]
    p = (x, y, z)
    d = _ellipsoid(p, (0, 4, 70), (22.5, 27, 25))                                        # skull
    d = _union(d, _ellipsoid(p, (0, -4, 54), (17.5, 20, 22)), 9)                         # face
    d = _union(d, _ellipsoid(p, (0, -17, 36.5), (8, 7, 6)), 8)                           # chin
    d = _union(d, _ellipsoid(p, (13, -8, 42), (5, 12, 7)), 9)                            # jaw
    d = _union(d, _ellipsoid(p, (11.5, -16, 54), (5.5, 5, 5)), 7)                        # cheek
    d = _union(d, _capsule(p, (0, -25, 67), (14, -19, 68), 2.6, 2.0), 5)                 # brow
    d = _without(d, _ellipsoid(p, (8.8, -26, 61.5), (5.6, 7, 4)), 4)                     # socket of the eye
    d = _union(d, _ellipsoid(p, (8.6, -18, 61), (4.6, 4, 3.2)), 0.8)                     # eye
    d = _union(d, _capsule(p, (0, -24, 66), (0, -31.5, 53.5), 2.2, 3.3), 3)              # nose
    d = _union(d, _ellipsoid(p, (0, -21, 55), (4.5, 8.5, 6)), 3)
    d = _union(d, _ellipsoid(p, (3.7, -26.6, 52.6), (2.6, 3.6, 2.5)), 2)                   # its side
    d = _union(d, _capsule(p, (0, -25.6, 46.3), (6.2, -22, 45.4), 1.9, 0.8), 2)          # lips
    d = _union(d, _capsule(p, (0, -25, 42.6), (5.2, -22, 43.4), 2.2, 0.9), 2)
    d = _without(d, _capsule(p, (0, -29, 44.6), (8, -24, 44.4), 0.9, 0.5), 1)
    ear = _ellipsoid(p, (24, 6, 59), (3.0, 7.0, 11), -0.25)
    ear = _without(ear, _ellipsoid(p, (28, 5, 60), (3.2, 4.6, 7.6), -0.25), 1.5)
    d = _union(d, ear, 5)
    d = _union(d, _capsule(p, (0, 9, 52), (0, 13, 14), 11.5, 13), 7)                     # neck
    d = _union(d, _ellipsoid(p, (0, 13, 3), (34, 15, 13)), 9)                            # shoulders
    return _without(d, z - 0.6, 3)


def head():
    box = (-42, -36, -4, 42, 40, 100)
    return Manifold.level_set(lambda x, y, z: -_head(x, y, z), box, 2.32, 0.0, 0.05)


def soap(length=80.0, depth=26.0, height=50.0, corner=9.0):
    """A bar that stands on its edge, with a shallow oval in both faces."""
    def distance(x, y, z):
        q = [abs(a) - b / 2 + corner for a, b in zip((x, y, z - height / 2 - 0.2), (length, depth, height))]
        bar = math.hypot(*(max(a, 0) for a in q)) + min(max(q), 0) - corner
        dent = _ellipsoid((x, abs(y), z - height / 2), (0, depth / 2 + 22, 0), (27, 25, 15))
        return -_without(bar, dent, 3)

    return Manifold.level_set(distance, (-42, -16, -2, 42, 16, 53), 2.2, 0.0, 0.05)


def flame():
    """A drop with its point up, around the top of the wick."""
    angle = np.linspace(0, math.pi, 20)
    radius = 4.2 * np.sin(angle) * np.cos(angle / 2) ** 0.9
    return turned(CrossSection([list(zip(radius, 72 - 13 * np.cos(angle)))]), 32)


def wick():
    """A bent thread that stands in the wax: a mesh, as all that reaches into a body has to be."""
    return Manifold.cylinder(8.1, 0.7, 0.7, 16).translate((0, 0, 54.4)).warp(lambda p: (p[0] + 0.07 * (p[2] - 54.4), *p[1:]))


MESHES = {"bumpy_ball": bumpy_ball, "candle": candle, "candle_hollow": lambda: candle(hollow=True), "flame": flame, "wick": wick,
          "black_ball": lambda: Manifold.sphere(9, 64).translate((0, 0, 43.5)),
          "tumbler": tumbler, "milk": milk, "head": head, "soap": soap}

# ---- Mitsuba files

FRAME = """<!-- {what}  Written by translucent.py.  Lengths in mm, z is up. -->
<scene version="3.0.0">
<integrator type="path"/>
<sensor type="perspective">
    <float name="fov" value="{fov}"/> <string name="fov_axis" value="x"/>
    <transform name="to_world"> <lookat origin="{origin}" target="{target}" up="0, 0, 1"/> </transform>
    <film type="hdrfilm"> <integer name="width" value="512"/> <integer name="height" value="512"/> </film>
</sensor>
{parts}
</scene>
"""


def text(numbers):
    return ", ".join(f"{number:.4g}" for number in numbers)


def matt(*colour):
    return f'<bsdf type="twosided"> <bsdf type="diffuse"> <rgb name="reflectance" value="{text(colour)}"/> </bsdf> </bsdf>'


def glass(inside, outside=1.0, roughness=0.0):
    kind = "roughdielectric" if roughness else "dielectric"
    facets = f' <string name="distribution" value="ggx"/> <float name="alpha" value="{roughness}"/>' if roughness else ""
    return (f'<bsdf type="{kind}"> <float name="int_ior" value="{inside}"/> <float name="ext_ior" value="{outside}"/>{facets}'
            " </bsdf>")


MATCHED = '<bsdf type="null"/>'


def shines(*radiance):
    return f'<emitter type="area"> <rgb name="radiance" value="{text(radiance)}"/> </emitter>'


FACETS = '<boolean name="face_normals" value="true"/> '


def mesh(name, file, bsdf, more=""):
    return f'<shape type="ply" id="{name}"> <string name="filename" value="{file}.ply"/> {more}{bsdf} </shape>'


def ball(name, centre, radius, more):
    return (f'<shape type="sphere" id="{name}"> <point name="center" value="{text(centre)}"/> '
            f'<float name="radius" value="{radius}"/> {more} </shape>')


def panel(name, centre, towards, half, more):
    """A rectangle around `centre` that faces `towards`."""
    return (f'<shape type="rectangle" id="{name}"> <transform name="to_world"> <scale value="{text((*half, 1))}"/> '
            f'<lookat origin="{text(centre)}" target="{text(towards)}" up="0, 0.01, 1"/> </transform> {more} </shape>')


def stage(floor, wall, behind=140.0):
    """A floor and a wall behind."""
    return [panel("floor", (0, 0, -0.2), (0, 0, 1), (600, 600), floor).replace("0, 0.01, 1", "0, 1, 0"),
            panel("wall", (0, behind, 0), (0, 0, 0), (600, 600), wall)]


def sky(*radiance):
    return f'<emitter type="constant" id="sky"> <rgb name="radiance" value="{text(radiance)}"/> </emitter>'


def candle_parts(hollow=False):
    """Facets where there is a shell: shading normals that differ from the true ones cost 1 % of the light there, 0.01 % of that
    of the solid candle (both of albedo 1, in a room of radiance 1)."""
    body = "candle_hollow" if hollow else "candle"
    return [*stage(matt(0.22, 0.16, 0.12), matt(0.16, 0.17, 0.2)),
            mesh("candle", body, glass(1.446), FACETS * hollow),
            mesh("wick", "wick", matt(0.03, 0.03, 0.03)), mesh("flame", "flame", shines(50, 29, 12)),
            panel("window", (-150, -120, 150), (0, 0, 40), (60, 60), shines(1.15, 1, 0.9)), sky(0.055, 0.05, 0.055)]


def head_parts(bsdf):
    return [*stage(matt(0.3, 0.3, 0.32), matt(0.2, 0.22, 0.26), 160), mesh("head", "head", bsdf),
            panel("window", (-120, -110, 130), (0, 0, 55), (55, 55), shines(6, 5.7, 5.3)),
            panel("lamp", (180, 60, 100), (0, 0, 60), (45, 45), shines(23, 20, 16)),
            sky(0.10, 0.11, 0.13)]


WARM = [*stage(matt(0.42, 0.43, 0.45), matt(0.3, 0.33, 0.38)), sky(0.12, 0.13, 0.15)]
PICTURES = {
    "bumpy_ball": ("A bumpy ball under a large lamp that stands behind it.", 30, (0, -190, 78), (0, 0, 38), [
        *WARM, mesh("ball", "bumpy_ball", glass(1.5)),
        panel("lamp", (120, 95, 110), (0, 0, 40), (50, 50), shines(15, 13.5, 12))]),
    "bumpy_ball_point": ("The same ball in the light of a point.", 30, (0, -190, 78), (0, 0, 38), [
        *WARM, mesh("ball", "bumpy_ball", glass(1.5)),
        '<emitter type="point" id="lamp"> <point name="position" value="120, 95, 110"/> '
        '<rgb name="intensity" value="150e3, 135e3, 120e3"/> </emitter>']),
    "candle": ("A candle that burns.", 34, (0, -165, 88), (0, 0, 43), candle_parts()),
    "candle_hollow": ("The same candle with air inside.", 34, (0, -165, 88), (0, 0, 43), candle_parts(hollow=True)),
    "candle_ball": ("The same candle with a black ball inside.", 34, (0, -165, 88), (0, 0, 43), [
        *candle_parts(), mesh("ball", "black_ball", matt(0, 0, 0))]),
    "glass_of_milk": ("A glass of milk.", 34, (0, -190, 110), (0, 0, 40), [
        *stage(matt(0.35, 0.2, 0.12), matt(0.25, 0.31, 0.36)),
        mesh("glass", "tumbler", glass(1.5)), mesh("milk", "milk", glass(1.35, 1.5)),
        panel("window", (-150, -30, 150), (0, 0, 45), (110, 110), shines(5, 5, 4.85)), sky(0.34, 0.365, 0.39)]),
    "head": ("A head of skin, with a lamp behind one ear.", 34, (-35, -190, 72), (0, 0, 50), head_parts(glass(1.4))),
    "bust": ("The head in marble, with an index that is matched.", 34, (-35, -190, 72), (0, 0, 50), head_parts(MATCHED)),
    "soap_and_lamp": ("A bar of soap with a lamp behind it.", 32, (-45, -175, 62), (0, 0, 26), [
        *stage(matt(0.4, 0.38, 0.36), matt(0.2, 0.26, 0.3)), mesh("soap", "soap", glass(1.47, roughness=0.1)),
        ball("lamp", (10, 34, 40), 13, shines(19, 16.5, 13.5)),
        panel("window", (-120, -60, 140), (0, 0, 30), (45, 45), shines(2, 2, 2)), sky(0.1, 0.11, 0.13)]),
}

# ---- scene files

SCENE = """# {what}
bakery_scene: 2
name: {name}
scene: {{mitsuba: {name}.xml, unit: 1 mm}}
stop: {{noise: 2%, time: 60 s, samples: 1024}}
materials:
  - {{where: {{shape: {shape}}}, recipe: ../../recipes/{recipe}.yaml{boundary}}}
{display}"""
EXPOSURES = {"candle": 1.8, "candle_hollow": 1.8, "candle_ball": 1.8, "soap_and_lamp": 1.4, "head": 1.2, "bust": 1.2}
# name: recipe, body, its index where it is not matched
BODIES = {
    "bumpy_ball": ("bumpy_sphere", "ball", 1.5),
    "bumpy_ball_point": ("bumpy_sphere", "ball", 1.5),
    "candle": ("wax", "candle", 1.446),
    "candle_hollow": ("wax", "candle", 1.446),
    "candle_ball": ("wax", "candle", 1.446),
    "glass_of_milk": ("catalogue/whole_milk", "milk", 0.9),
    "head": ("skin", "head", 1.4),
    "bust": ("marble", "head", None),
    "soap_and_lamp": ("soap", "soap", 1.47),
}


def main():
    for name, make in MESHES.items():
        made = make().to_mesh64()
        (HERE / f"{name}.ply").write_bytes(ply.mesh(made.vert_properties[:, :3], made.tri_verts, single=True))
    for name, (what, fov, origin, target, parts) in PICTURES.items():
        frame = FRAME.format(what=what, fov=fov, origin=text(origin), target=text(target), parts="\n".join(parts))
        (HERE / f"{name}.xml").write_text(frame)
        recipe, shape, index = BODIES[name]
        boundary = f", boundary: {{index: {index}}}" if index else ""
        display = f"display: {{exposure: {EXPOSURES[name]}}}\n" if name in EXPOSURES else ""
        scene = SCENE.format(what=what, name=name, recipe=recipe, shape=shape, boundary=boundary, display=display)
        (HERE / f"{name}.yaml").write_text(scene)


if __name__ == "__main__":
    main()
