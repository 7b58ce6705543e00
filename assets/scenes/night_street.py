"""Writes night_street.xml: python assets/scenes/night_street.py

A street at night, lengths in m: x across it, y along it (the camera looks that way), z up.  All shapes are Mitsuba's own.
"""

from __future__ import annotations

from pathlib import Path
from random import Random

HALF_STREET, KERB = 4.0, 6.5  # m from the middle: to the pavement, to the houses
WARM, COOL, LAMP = (1.0, 0.55, 0.2), (0.75, 0.85, 1.0), (1.0, 0.62, 0.28)
WALLS = ((0.32, 0.22, 0.18), (0.4, 0.36, 0.3), (0.25, 0.25, 0.28), (0.45, 0.4, 0.36), (0.3, 0.18, 0.14), (0.36, 0.33, 0.25))
FRAME = """<!-- A street at night.  Written by night_street.py.  Lengths in m, z is up. -->
<scene version="3.0.0">
<integrator type="path"> <integer name="max_depth" value="5"/> </integrator>
<sensor type="perspective">
    <float name="fov" value="58"/> <string name="fov_axis" value="x"/>
    <transform name="to_world"> <lookat origin="-1.6, -6, 1.7" target="0.5, 30, 4.4" up="0, 0, 1"/> </transform>
    <film type="hdrfilm">
        <integer name="width" value="800"/> <integer name="height" value="450"/>
        <rfilter type="box"/>
    </film>
    <sampler type="independent"> <integer name="sample_count" value="512"/> </sampler>
</sensor>
<emitter type="constant"> <rgb name="radiance" value="0.004, 0.006, 0.011"/> </emitter>
{bsdfs}
{shapes}
</scene>
"""
DIFFUSE = '<bsdf type="twosided" id="{}"> <bsdf type="diffuse"> <rgb name="reflectance" value="{}"/> </bsdf> </bsdf>'
WET = ('<bsdf type="roughplastic" id="road"> <float name="alpha" value="0.18"/>'
       ' <rgb name="diffuse_reflectance" value="0.05, 0.05, 0.055"/> </bsdf>')


def text(*numbers):
    return ", ".join(f"{number:.4g}" for number in numbers)


class Street:
    def __init__(self):
        self.shapes = []

    def shape(self, kind, bsdf, transform, radiance=None, weight=1):
        """`weight`: how often a light is sampled."""
        light = (f' <emitter type="area"> <rgb name="radiance" value="{text(*radiance)}"/>'
                 f' <float name="sampling_weight" value="{weight}"/> </emitter>') if radiance else ""
        self.shapes.append(f'<shape type="{kind}"> <transform name="to_world"> {transform} </transform>\n'
                           f'    <ref id="{bsdf}"/>{light} </shape>')

    def box(self, bsdf, low, high, radiance=None, turn=""):
        half = [(b - a) / 2 for a, b in zip(low, high)]
        middle = [(b + a) / 2 for a, b in zip(low, high)]
        self.shape("cube", bsdf, f'<scale value="{text(*half)}"/> {turn}<translate value="{text(*middle)}"/>', radiance)

    def ball(self, bsdf, place, radius, radiance=None, weight=1):
        self.shape("sphere", bsdf, f'<scale value="{radius}"/> <translate value="{text(*place)}"/>', radiance, weight)

    def house(self, random, side, y, width, floors, wall):
        """A house with its front at x = side * KERB."""
        height, depth = 3.1 * floors + 0.8, 9.0
        x = sorted((side * KERB, side * (KERB + depth)))
        self.box(wall, (x[0], y, 0), (x[1], y + width, height))
        self.box("trim", (x[0] - 0.18, y - 0.05, height - 0.35), (x[1] + 0.18, y + width + 0.05, height))
        # a ridge along the street: a cube that stands on its edge
        middle, half = (x[0] + x[1]) / 2, (depth / 2 + 0.3) / 2**0.5
        self.shape("cube", "roof", f'<scale value="{text(half, width / 2, half)}"/> <rotate y="1" angle="45"/> '
                   f'<scale value="1, 1, 0.62"/> <translate value="{text(middle, y + width / 2, height - 0.02)}"/>')
        self.box("roof", (middle - 1.6 * side - 0.35, y + 1, height), (middle - 1.6 * side + 0.35, y + 1.9, height + 3.4))
        count = max(2, round(width / 2.4))
        step = width / count
        for floor in range(floors):
            shop = floor == 0 and random.random() < 0.35
            for k in range(count):
                if floor == 0 and k == count // 2:
                    self.front(side, "door", y + (k + 0.5) * step, 0, 1.0, 2.3)
                    continue
                lit = random.random() < (0.9 if shop else 0.34)
                colour = COOL if random.random() < 0.18 else WARM
                level = (2.4 if shop else random.uniform(0.7, 1.9)) * (0.9 + 0.2 * random.random())
                sill, wide, high = (0.7, 1.7, 1.6) if shop else (1.1, 1.05, 1.5)
                light = [level * c for c in colour] if lit else None
                self.window(side, y + (k + 0.5) * step, 3.1 * floor + sill, wide, high, light)

    def front(self, side, bsdf, y, z, width, height, radiance=None, out=0.03):
        x = sorted((side * KERB, side * (KERB - out)))
        self.box(bsdf, (x[0], y - width / 2, z), (x[1], y + width / 2, z + height), radiance)

    def window(self, side, y, z, width, height, radiance):
        self.front(side, "trim", y, z - 0.08, width + 0.24, height + 0.16, out=0.04)
        self.shape("rectangle", "glass", f'<scale value="{text(height / 2, width / 2, 1)}"/> '
                   f'<rotate y="1" angle="{-90 * side}"/> <translate value="{text(side * (KERB - 0.05), y, z + height / 2)}"/>',
                   radiance)
        self.front(side, "trim", y, z, 0.07, height, out=0.08)
        self.front(side, "trim", y, z + 0.62 * height, width, 0.06, out=0.08)

    def lamp(self, side, y):
        x = side * (HALF_STREET + 0.5)
        self.box("iron", (x - 0.07, y - 0.07, 0), (x + 0.07, y + 0.07, 4.6))
        self.box("iron", (x - 0.14, y - 0.14, 0), (x + 0.14, y + 0.14, 0.7))
        self.ball("iron", (x, y, 4.85), 0.24, [70 * c for c in LAMP], 10)
        self.box("iron", (x - 0.26, y - 0.26, 5.12), (x + 0.26, y + 0.26, 5.2))

    def car(self, x, y, ahead):
        """`ahead` is -1 for a car that comes towards the camera."""
        self.box("paint", (x - 0.9, y - 2.1, 0.35), (x + 0.9, y + 2.1, 0.95))
        self.box("glass", (x - 0.75, y - 1.1, 0.95), (x + 0.75, y + 1.2, 1.45))
        for wheel in (-1.35, 1.35):
            self.box("iron", (x - 0.92, y + wheel - 0.32, 0), (x + 0.92, y + wheel + 0.32, 0.6))
        for left in (-0.62, 0.62):
            front, back = y + ahead * 2.1, y - ahead * 2.1
            self.ball("iron", (x + left, front, 0.68), 0.11, (160, 150, 125) if ahead < 0 else None, 5)
            self.box("iron", (x + left - 0.14, back - 0.03, 0.62), (x + left + 0.14, back + 0.03, 0.76),
                     (9, 0.35, 0.2) if ahead > 0 else None)


def street():
    random, made = Random(11), Street()
    made.box("road", (-60, -30, -0.5), (60, 220, 0))
    for side in (-1, 1):
        x = sorted((side * HALF_STREET, side * KERB))
        made.box("pavement", (x[0], -30, -0.1), (x[1], 120, 0.14))
        y, turn = -14.0, 0 if side < 0 else 3
        while y < 84:
            width = random.choice((7.0, 8.5, 10.0, 12.0))
            if not (side > 0 and 36 < y < 44):  # a lane
                made.house(random, side, y, width, random.choice((2, 3, 3, 4)), f"wall{turn % len(WALLS)}")
            y, turn = y + width + random.choice((0.0, 0.0, 0.0, 1.2)), turn + 1
        for k in range(7):
            made.lamp(side, 6.0 + 15 * k + (7.5 if side > 0 else 0))
    # a tower across the far end
    made.box("wall2", (-5, 104, 0), (5, 114, 26))
    made.shape("cube", "roof", '<scale value="3.6, 3.6, 3.6"/> <rotate y="1" angle="45"/> <scale value="1, 1.35, 2.2"/> '
               '<translate value="0, 109, 26"/>')
    made.shape("disk", "glass", '<scale value="1.7"/> <rotate x="1" angle="90"/> <translate value="0, 103.9, 20"/>',
               (5, 4.2, 2.6))
    for x in (-1.6, 1.6):
        made.box("glass", (x - 0.6, 103.85, 7), (x + 0.6, 104, 12), (1.6, 0.8, 0.3))
    made.car(-1.9, 34, -1)
    made.car(2.1, 15, 1)
    made.car(3.0, 48, 1)
    return made


def main():
    bsdfs = [DIFFUSE.format(name, text(*colour)) for name, colour in
             [(f"wall{i}", wall) for i, wall in enumerate(WALLS)] + [("trim", (0.5, 0.47, 0.42)), ("roof", (0.1, 0.08, 0.08)),
              ("door", (0.12, 0.05, 0.03)), ("pavement", (0.18, 0.17, 0.16)), ("glass", (0.02, 0.025, 0.03)),
              ("iron", (0.03, 0.03, 0.03)), ("paint", (0.25, 0.03, 0.03))]]
    made = FRAME.format(bsdfs="\n".join([*bsdfs, WET]), shapes="\n".join(street().shapes))
    Path(__file__).with_suffix(".xml").write_text(made)


if __name__ == "__main__":
    main()
