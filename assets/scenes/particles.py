"""Writes the Mitsuba files of the scenes of separate particles: python assets/scenes/particles.py

Lengths in m, z up, the camera looks along y.  Shapes are Mitsuba's own but for one cone, cone.ply.  Light comes from few sources,
most of them points and spots, so that few samples do; what shows of a lamp is a shape that shines little besides.
"""

from __future__ import annotations

import math
from pathlib import Path
from random import Random

import numpy as np

HERE = Path(__file__).parent
FRAME = """<!-- {what}  Written by {program}.  Lengths in m, z is up. -->
<scene version="3.0.0">
<integrator type="path"/>
<sensor type="perspective">
    <float name="fov" value="{fov}"/> <string name="fov_axis" value="x"/>
    <transform name="to_world"> <lookat origin="{origin}" target="{target}" up="0, 0, 1"/> </transform>
    <film type="hdrfilm"> <integer name="width" value="{size[0]}"/> <integer name="height" value="{size[1]}"/> </film>
</sensor>
{parts}
</scene>
"""


def text(numbers):
    return ", ".join(f"{number:.4g}" for number in numbers)


def _light(shines, weight):
    return "" if shines is None else (f'<emitter type="area"> <rgb name="radiance" value="{text(shines)}"/>'
                                      f' <float name="sampling_weight" value="{weight}"/> </emitter> ')


class Scene:
    program = "particles.py"

    def __init__(self, what, size, fov, origin, target, **colours):
        self.frame = {"what": what, "program": self.program, "size": size, "fov": fov, "origin": text(origin),
                      "target": text(target)}
        self.parts = [f'<bsdf type="twosided" id="{name}"> <bsdf type="diffuse"> <rgb name="reflectance" value="{text(colour)}"/>'
                      ' </bsdf> </bsdf>' for name, colour in colours.items()]

    def add(self, part):
        self.parts.append(part)

    def shape(self, kind, bsdf, transform, more="", name=""):
        label = f' id="{name}"' if name else ""
        self.add(f'<shape type="{kind}"{label}> {more}<transform name="to_world"> {transform} </transform>'
                 f' <ref id="{bsdf}"/> </shape>')

    def box(self, bsdf, low, high, turn=0):
        half, middle = ([(b + s * a) / 2 for a, b in zip(low, high)] for s in (-1, 1))
        self.shape("cube", bsdf, f'<scale value="{text(half)}"/> <rotate z="1" angle="{turn}"/>'
                   f' <translate value="{text(middle)}"/>')

    def ball(self, bsdf, place, radius, shines=None, name="", weight=0.1):
        """`weight`: how often its light is sampled."""
        self.shape("sphere", bsdf, f'<scale value="{radius:.4g}"/> <translate value="{text(place)}"/>',
                   _light(shines, weight), name)

    def rod(self, bsdf, start, end, radius):
        points = "".join(f'<point name="p{i}" value="{text(place)}"/> ' for i, place in enumerate((start, end)))
        self.add(f'<shape type="cylinder"> {points}<float name="radius" value="{radius}"/> <ref id="{bsdf}"/> </shape>')

    def cone(self, bsdf, place, radius, height):
        self.shape("ply", bsdf, f'<scale value="{text((radius, radius, height))}"/> <translate value="{text(place)}"/>',
                   '<string name="filename" value="cone.ply"/> ')

    def pane(self, bsdf, place, half, turn, shines=None, name="", weight=0.1):
        self.shape("rectangle", bsdf, f'<scale value="{text((*half, 1))}"/> {turn} <translate value="{text(place)}"/>',
                   _light(shines, weight), name)

    def spot(self, name, origin, target, intensity, cutoff, beam):
        self.add(f'<emitter type="spot" id="{name}"> <transform name="to_world"> <lookat origin="{text(origin)}"'
                 f' target="{text(target)}" up="0.1, 0.3, 1"/> </transform> <rgb name="intensity" value="{text(intensity)}"/>'
                 f' <float name="cutoff_angle" value="{cutoff}"/> <float name="beam_width" value="{beam}"/> </emitter>')

    def point(self, name, place, intensity):
        self.add(f'<emitter type="point" id="{name}"> <point name="position" value="{text(place)}"/>'
                 f' <rgb name="intensity" value="{text(intensity)}"/> </emitter>')

    def sun(self, name, direction, irradiance):
        self.add(f'<emitter type="directional" id="{name}"> <vector name="direction" value="{text(direction)}"/>'
                 f' <rgb name="irradiance" value="{text(irradiance)}"/> </emitter>')

    def around(self, name, radiance, weight=0.3):
        self.add(f'<emitter type="constant" id="{name}"> <rgb name="radiance" value="{text(radiance)}"/>'
                 f' <float name="sampling_weight" value="{weight}"/> </emitter>')

    def write(self, name):
        (HERE / f"{name}.xml").write_text(FRAME.format(parts="\n".join(self.parts), **self.frame))


FACING = '<rotate x="1" angle="90"/>'  # turns a rectangle towards the camera


def lamp():
    s = Scene("A lamp on a table.", (400, 300), 40, (0, -1.3, 0.4), (0, 0, 0.31), wood=(0.05, 0.025, 0.012),
              wall=(0.015, 0.017, 0.025), iron=(0.02, 0.02, 0.02), cover=(0.04, 0.1, 0.16), apple=(0.25, 0.03, 0.015))
    s.box("wood", (-1.2, -0.5, -0.04), (1.2, 0.7, 0))
    s.pane("wall", (0, 1.4, 1), (4, 3), FACING)
    s.box("iron", (0.3, 0.2, 0), (0.46, 0.36, 0.02))
    s.box("iron", (0.37, 0.27, 0), (0.39, 0.29, 0.74))
    s.rod("iron", (0.38, 0.28, 0.74), (0.12, 0.22, 0.7), 0.009)
    s.rod("iron", (0.12, 0.22, 0.72), (0.095, 0.185, 0.62), 0.06)
    s.ball("iron", (0.1, 0.19, 0.615), 0.03, (3, 2.2, 1.3), "bulb")
    s.spot("lamp", (0.092, 0.18, 0.575), (-0.05, -0.02, 0), (1, 0.75, 0.45), 38, 30)
    s.box("cover", (-0.33, -0.03, 0), (-0.07, 0.15, 0.04), turn=24)
    s.ball("apple", (-0.2, 0.06, 0.08), 0.04)
    s.around("room", (0.0015, 0.002, 0.003), 0.1)
    return s


def beads():
    s = Scene("A Cornell box of 0.4 m.", (300, 300), 31, (0, -0.98, 0.2), (0, 0, 0.2), white=(0.72, 0.72, 0.7),
              red=(0.6, 0.06, 0.05), green=(0.12, 0.45, 0.1), dark=(0, 0, 0))
    for place, turn, bsdf in (((0, 0, 0), "", "white"), ((0, 0, 0.4), "", "white"), ((0, 0.2, 0.2), FACING, "white"),
                              ((-0.2, 0, 0.2), '<rotate y="1" angle="90"/>', "red"),
                              ((0.2, 0, 0.2), '<rotate y="1" angle="90"/>', "green")):
        s.pane(bsdf, place, (0.2, 0.2), turn)
    s.box("white", (-0.135, 0, 0), (-0.015, 0.12, 0.24), turn=20)
    s.box("white", (0.017, -0.118, 0), (0.133, -0.002, 0.12), turn=-17)
    s.pane("dark", (0, 0, 0.399), (0.06, 0.05), '<rotate x="1" angle="180"/>', (16, 13, 9), "lamp", 1)
    return s


def stairs():
    s = Scene("A staircase with a window.", (320, 400), 46, (-0.9, -3.4, 1.25), (0.15, 0, 1.3), plaster=(0.16, 0.14, 0.12),
              stone=(0.14, 0.12, 0.1), wood=(0.07, 0.035, 0.02))
    s.box("wood", (-1.6, -3.6, -0.1), (1.6, 2, 0))
    s.box("plaster", (-1.6, 2, 0), (1.6, 2.1, 3))
    s.box("plaster", (-1.7, -3.6, 0), (-1.6, 2.1, 3))
    s.box("plaster", (-1.7, -3.6, 3), (1.7, 2.1, 3.1))
    # the wall with the window
    for low, high in (((-3.6, 0), (0, 3)), ((0, 0), (0.9, 1.6)), ((0, 2.6), (0.9, 3)), ((0.9, 0), (2.1, 3))):
        s.box("plaster", (1.5, *low), (1.7, *high))
    for y in (0.29, 0.6):
        s.box("wood", (1.57, y - 0.02, 1.6), (1.63, y + 0.02, 2.6))
    s.box("wood", (1.57, 0, 2.08), (1.63, 0.9, 2.12))
    for i in range(8):
        s.box("stone", (-1.6, 0.28 * i - 0.4, 0), (0.2, 2, 0.17 * (i + 1)))
        s.box("wood", (0.12, 0.28 * i - 0.28, 0.17 * (i + 1)), (0.15, 0.28 * i - 0.25, 0.17 * (i + 1) + 0.8))
    s.shape("cube", "wood", '<scale value="0.035, 1.2, 0.025"/> <rotate x="1" angle="31.3"/>'
            ' <translate value="0.135, 0.72, 1.67"/>')
    s.sun("sun", (-0.72, -0.3, -0.62), (8, 6.6, 4.6))
    s.point("room", (-0.2, -2.4, 2.7), (0.3, 0.42, 0.62))
    return s


def snow():
    s = Scene("A hut in the snow, at night.", (400, 300), 58, (0.3, -6.8, 1.5), (0.1, 0, 1.75),
              snow=(0.75, 0.77, 0.8), wall=(0.14, 0.08, 0.05),
              trim=(0.3, 0.28, 0.25), bark=(0.05, 0.04, 0.03),
              glass=(0.05, 0.05, 0.05), fir=(0.03, 0.06, 0.04))
    s.box("snow", (-40, -20, -0.5), (40, 40, 0))
    drifts = (-3.6, -1, 6, 0.28), (3.2, -3, 8, 0.2), (-0.5, 4, 12, 0.3), (4.6, 0.8, 5, 0.4), (-1.9, 1, 3, 0.2)
    for x, y, radius, height in drifts:
        s.ball("snow", (x, y, height - radius), radius)
    s.box("wall", (-0.2, 2.2, 0), (3.6, 5.5, 2.1))
    for side in (-1, 1):  # gable as a cube on its edge, and the snow on it
        s.shape("cube", "snow", f'<scale value="1.5, 1.9, 0.1"/> <rotate y="1" angle="{31.8 * side}"/>'
                f' <translate value="{1.7 + 1.14 * side}, 3.85, 2.64"/>')
    s.shape("cube", "wall", '<scale value="1.36, 1.65, 1.36"/> <rotate y="1" angle="45"/> <scale value="1, 1, 0.62"/>'
            ' <translate value="1.7, 3.85, 2.1"/>')
    s.box("wall", (2.6, 3.6, 2.4), (3, 4, 3.6))
    s.box("snow", (2.55, 3.55, 3.6), (3.05, 4.05, 3.7))
    s.pane("glass", (0.7, 2.18, 1.2), (0.36, 0.38), FACING, (1.6, 0.85, 0.3), "window", 0.5)
    s.box("trim", (0.69, 2.13, 0.8), (0.71, 2.19, 1.6))
    s.box("trim", (0.33, 2.13, 1.19), (1.07, 2.19, 1.21))
    s.box("trim", (1.9, 2.16, 0), (2.7, 2.2, 1.75))
    s.box("bark", (-2.05, 0.95, 0), (-1.95, 1.05, 3))
    s.box("bark", (-2.2, 0.8, 3.42), (-1.8, 1.2, 3.48))
    s.ball("bark", (-2, 1, 3.16), 0.13, (12, 8, 4), "lantern", 0.05)
    s.point("flame", (-2, 0.85, 3.16), (5, 3.4, 1.8))
    random = Random(4)
    for x, y, height in ((-4.6, 3.5, 4.2), (-6.5, 5, 5), (5.6, 6, 5), (-3.2, 7, 4.4), (7.2, 4, 4), (-0.8, 9, 5), (-8.5, 7, 5.5)):
        for k in range(4):
            width = height * (0.24 - 0.045 * k) * random.uniform(0.9, 1.1)
            s.cone("fir", (x, y, height * (0.1 + 0.2 * k)), width, 0.38 * height)
            s.cone("snow", (x + 0.03, y, height * (0.24 + 0.2 * k)), 0.55 * width, 0.28 * height)
    s.around("night", (0.0032, 0.005, 0.01))
    return s


def bubbles():
    s = Scene("The floor of the sea, shafts of light from above.", (400, 300), 50, (0, -1.25, 0.42), (0, 0, 0.55),
              sand=(0.22, 0.2, 0.15), rock=(0.05, 0.06, 0.06), coral=(0.5, 0.07, 0.05))
    s.box("sand", (-3, -2, -0.1), (3, 1.6, 0))
    random = Random(3)
    for k in range(16):
        x, radius = -2.2 + 0.29 * k, random.uniform(0.18, 0.42)
        s.ball("rock", (x, 0.95 + random.uniform(-0.15, 0.2), 0.05 * radius), radius)
    rocks = ((-0.42, 0.25, 0.2, -0.06), (-0.2, 0.4, 0.13, -0.02), (0.5, 0.35, 0.24, -0.09), (0.33, 0.12, 0.09, 0),
             (-0.6, -0.1, 0.1, 0))
    for x, y, radius, up in rocks:
        s.ball("rock", (x, y, up), radius)
    for _ in range(14):
        angle, height = random.uniform(0, 2 * math.pi), random.uniform(0.2, 0.32)
        x, y = -0.42 + 0.12 * math.cos(angle), 0.22 + 0.1 * math.sin(angle)
        end = (x + 0.05 * math.cos(angle), y + 0.05 * math.sin(angle), height)
        s.rod("coral", (x, y, 0.06), end, 0.008)
        s.ball("coral", end, 0.014)
    for k, (begin, end) in enumerate(((0.1, -0.42), (0.55, 0.05), (1.1, 0.5))):
        s.spot(f"shaft{k + 1}", (begin, 0.75, 2), (end, 0.15, 0), (6, 8.6, 8), 8, 5)
    s.around("sea", (0.0012, 0.009, 0.018))
    return s


def drive():
    s = Scene("A road at night.", (420, 280), 52, (1.7, -19, 1.25), (1.2, 0, 1.15), grass=(0.02, 0.035, 0.015),
              line=(0.5, 0.5, 0.45), iron=(0.03, 0.03, 0.03), paint=(0.03, 0.05, 0.12), post=(0.5, 0.5, 0.5))
    s.add('<bsdf type="twosided" id="road"> <bsdf type="roughplastic">'
          ' <rgb name="diffuse_reflectance" value="0.035, 0.035, 0.04"/> <float name="alpha" value="0.15"/> </bsdf> </bsdf>')
    s.box("grass", (-60, -30, -0.3), (60, 120, -0.02))
    s.box("road", (-3.5, -30, -0.2), (3.5, 120, 0))
    for k in range(12):
        s.box("line", (-0.07, 6 * k - 18, 0), (0.07, 6 * k - 15, 0.005))
    for x in (-3.3, 3.3):
        s.box("line", (x - 0.06, -30, 0), (x + 0.06, 120, 0.005))
    for k in range(8):
        s.box("post", (4, 8 * k - 14, 0), (4.12, 8 * k - 13.9, 0.9))
    s.box("paint", (-2.7, 6, 0.35), (-0.9, 10, 0.95))
    s.box("iron", (-2.55, 7, 0.95), (-1.05, 9.4, 1.45))
    for k, x in enumerate((-2.4, -1.2)):
        s.ball("iron", (x, 5.95, 0.68), 0.09, (40, 38, 34), f"glare{k + 1}", 0.05)
    s.spot("oncoming", (-1.8, 5.8, 0.75), (-0.2, -12, 0.5), (90, 86, 78), 35, 12)
    for k, y in enumerate((-7, 11)):
        s.box("iron", (4.7, y - 0.06, 0), (4.82, y + 0.06, 5))
        s.box("iron", (3.2, y - 0.04, 4.95), (4.82, y + 0.04, 5.03))
        s.ball("iron", (3.3, y, 4.8), 0.13, (8, 4.8, 1.8), f"bulb{k + 1}", 0.05)
        s.spot(f"lamp{k + 1}", (3.3, y, 4.62), (2.6, y, 0), (9, 5.4, 2), 75, 40)
    s.spot("own", (1.7, -18.2, 0.65), (1.5, -2, 0.5), (150, 140, 120), 20, 10)
    s.around("night", (0.0015, 0.002, 0.0035))
    return s


SCENES = {"lamp_in_dust": lamp, "beads_in_box": beads, "stairs_in_a_beam": stairs, "snow_at_night": snow,
          "bubbles_in_light": bubbles, "drive_in_drizzle": drive}


def write_cone(path, sides=24):
    """A closed cone of radius and height 1 on the plane z = 0, with normals that are smooth around it and end at its rim."""
    around = 2 * np.pi * np.arange(2 * sides) / (2 * sides)  # rim and, between its vertices, the tip of each side
    out = np.stack([np.cos(around), np.sin(around), np.zeros(2 * sides)], axis=1)
    slanted = (out + [0, 0, 1]) / math.sqrt(2)
    rim, tips, down = out[::2], np.tile([0, 0, 1], (sides, 1)), np.tile([0, 0, -1], (sides + 1, 1))
    vertices = np.concatenate([rim, tips, rim, [[0, 0, 0]]])
    normals = np.concatenate([slanted[::2], slanted[1::2], down])
    after = (np.arange(sides) + 1) % sides
    k = np.arange(sides)
    faces = np.concatenate([np.stack([k, after, sides + k], axis=1),
                            np.stack([2 * sides + after, 2 * sides + k, np.full(sides, 3 * sides)], axis=1)])
    head = ["ply", "format ascii 1.0", f"element vertex {len(vertices)}",
            *(f"property float {name}" for name in ("x", "y", "z", "nx", "ny", "nz")),
            f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header"]
    lines = [*head, *(" ".join(f"{number:.5g}" for number in row) for row in np.concatenate([vertices, normals], axis=1)),
             *(f"3 {a} {b} {c}" for a, b, c in faces)]
    path.write_text("\n".join(lines) + "\n")


def main():
    write_cone(HERE / "cone.ply")
    for name, made in SCENES.items():
        made().write(name)


if __name__ == "__main__":
    main()
