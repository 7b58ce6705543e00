"""Writes the scenes of several materials: python assets/scenes/mixed.py     (needs manifold3d and mitsuba, of the extras)

Meshes, a sky, Mitsuba files and scene files.  Lengths in m, z up, the camera looks along y.  Candle, flame, wick, glass and milk
are the meshes of translucent.py, in mm.  Light comes from surfaces of some width: what shines through a boundary that turns
light, or onto clear grains, is found by chance only.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parents[1]), str(HERE)]

import numpy as np  # noqa: E402
import particles  # noqa: E402
from granular import turned  # noqa: E402
from particles import FACING, text  # noqa: E402
from translucent import glass, matt, shines  # noqa: E402

from bakery.store import ply  # noqa: E402


class Scene(particles.Scene):
    program = "mixed.py"

    def mesh(self, name, file, surface, scale=1.0, place=(0, 0, 0)):
        """A mesh with an id; `surface`: XML of its BSDF or of its light."""
        self.add(f'<shape type="ply" id="{name}"> <string name="filename" value="{file}.ply"/> <transform name="to_world"> '
                 f'<scale value="{scale:.4g}"/> <translate value="{text(place)}"/> </transform> {surface} </shape>')


def dim(light):
    """A light of which surfaces and fog ask less often than of others."""
    return light.replace("</emitter>", '<float name="sampling_weight" value="0.3"/> </emitter>')


def write_mesh(name, vertices, faces):
    (HERE / f"{name}.ply").write_bytes(ply.mesh(vertices, faces, single=True))


# ---- a winter evening


def heap(radius=0.12):
    """A heap, 0.7 of its radius high, on the wall in front."""
    profile = [(0, 0), *((r, 0.02 + 0.68 * (1 - r * r) ** 1.3) for r in np.linspace(1, 0, 25))]
    profile.insert(1, (1, 0))

    def dented(place):
        x, y, z = np.asarray(place).T
        return np.stack([x, y, z * (1 + 0.2 * np.sin(3 * x + 1) * np.cos(3.7 * y) + 0.1 * np.sin(7 * x + 4 * y))], 1)

    made = turned([profile], 64).warp_batch(dented).to_mesh64()
    return np.array(made.vert_properties)[:, :3] * radius + (-0.1, -0.52, LEDGE), np.array(made.tri_verts)


def cushion(length=0.64, width=0.11):
    """Snow on the window's sill, outside."""
    x, y = np.meshgrid(np.linspace(-1, 1, 81), np.linspace(-1, 1, 25), indexing="ij")
    height = (1 - x**8) ** 0.5 * (1 - y**2) ** 0.5 * (0.034 + 0.009 * np.sin(9 * x + 2 * y) + 0.004 * np.sin(23 * x))
    return closed(length / 2 * x, width / 2 * y - 0.045, SILL - 0.024 + height, SILL - 0.028)


SILL = 0.13  # height of the window's sill
LEDGE = 0.1  # height of the wall on which the heap lies


def winter():
    s = Scene("A window on a winter evening.", (320, 240), 42, (0.02, -1.15, 0.34), (0.02, 0, 0.235),
              snow=(0.82, 0.84, 0.88), wall=(0.16, 0.09, 0.06), stone=(0.2, 0.2, 0.21), trim=(0.55, 0.53, 0.5),
              board=(0.3, 0.17, 0.08), room=(0.7, 0.55, 0.4), dark=(0.02, 0.02, 0.02))
    # the front of the house around its window, and what lies on its sill
    for low, high in (((-1.5, -0.5), (-0.3, 1.2)), ((0.3, -0.5), (1.5, 1.2)), ((-0.3, -0.5), (0.3, SILL - 0.02)),
                      ((-0.3, 0.58), (0.3, 1.2))):
        s.box("wall", (low[0], 0, low[1]), (high[0], 0.1, high[1]))
    for x in (-0.3, -0.0, 0.3):
        s.box("trim", (x - 0.013, 0.02, SILL), (x + 0.013, 0.045, 0.58))
    for z in (0.4, 0.58):
        s.box("trim", (-0.3, 0.022, z - 0.011), (0.3, 0.043, z + 0.011))
    s.box("board", (-0.33, -0.05, SILL - 0.025), (0.33, 0.3, SILL))
    s.mesh("cushion", "snow_cushion", matt(0.82, 0.84, 0.88))
    # the room
    for place, half, turn in (((0, 1, 0.3), (0.8, 0.6), FACING),
                              ((0, 0.55, -0.1), (0.8, 0.46), ""), ((0, 0.55, 0.8), (0.8, 0.46), ""),
                              ((-0.8, 0.55, 0.3), (0.6, 0.46), '<rotate y="1" angle="90"/>'),
                              ((0.8, 0.55, 0.3), (0.6, 0.46), '<rotate y="1" angle="90"/>')):
        s.pane("room", place, half, turn)
    s.pane("dark", (0, 0.55, 0.79), (0.7, 0.4), '<rotate x="1" angle="180"/>', (1.5, 0.95, 0.48), "ceiling", 1)
    candle, milk = (-0.14, 0.15, SILL + 0.0003), (0.14, 0.15, SILL + 0.0003)
    s.mesh("candle", "candle", glass(1.446), 1.9e-3, candle)
    s.mesh("wick", "wick", matt(0.03, 0.03, 0.03), 1.9e-3, candle)
    s.mesh("flame", "flame", dim(shines(30, 17, 6)), 1.9e-3, candle)
    s.mesh("glass", "tumbler", glass(1.5), 1.5e-3, milk)
    s.mesh("milk", "milk", glass(1.35, 1.5), 1.5e-3, milk)
    # a wall in front, and the heap
    s.box("stone", (-0.8, -0.66, -0.4), (0.8, -0.4, LEDGE))
    s.box("snow", (-2, -3, -0.45), (2, 0, -0.4))
    # the sky, near enough that it is seen through fog
    s.add('<shape type="sphere" id="dusk"> <point name="center" value="0, 0, 0"/> <float name="radius" value="3.5"/> <boolean '
          f'name="flip_normals" value="true"/> <bsdf type="diffuse"> <rgb name="reflectance" value="0"/> '
          f'</bsdf> {dim(shines(0.2, 0.32, 0.6))} </shape>')
    return s


# ---- a beach


def shore(x):
    """Where dry sand ends."""
    return 0.2 + 0.03 * np.sin(6 * x + 0.5) + 0.015 * np.sin(17 * x)


def ground(x, y):
    """Height of the sand: a beach that sinks into the sea."""
    ripples = 0.0012 * np.sin(150 * y + 9 * np.sin(11 * x))
    return 0.012 - 0.06 * np.maximum(y - 0.1, 0) + ripples * np.clip(1 - y, 0, 1)


def grid(x, y, height):
    """Vertices (X * Y, 3) above arrays x, y (X, Y), and faces that look up."""
    rows, columns = x.shape
    number = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    faces = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    return np.stack([x, y, height], -1).reshape(-1, 3), faces


def strip(inner, outer, count):
    """Sand between two distances from the line where dry sand ends."""
    x, away = np.meshgrid(np.sinh(np.linspace(-4.2, 4.2, 91)) / 12, np.linspace(inner, outer, count), indexing="ij")
    y = shore(x) + away
    return grid(x, y, ground(x, y))


def waves(x, y):
    """Height of the sea: waves that run ashore, and small ones across them."""
    height = np.zeros_like(x)
    for length, angle, high, phase in ((0.31, 0.1, 1, 0.4), (0.19, -0.25, 0.6, 2), (0.11, 0.5, 0.35, 1), (0.07, -0.6, 0.2, 3),
                                       (0.045, 0.9, 0.11, 5), (0.031, -0.2, 0.08, 4)):
        turn = 2 * math.pi / length * (y * math.cos(angle) + x * math.sin(angle)) + phase
        height += high * (np.exp(np.sin(turn) - 1) - 0.4)  # crests are narrower than troughs
    return 0.007 * height * np.clip(0.25 + y, 0, 1)


def closed(x, y, height, floor):
    """A solid between a surface above arrays x, y (X, Y) and the plane z = floor."""
    top, faces = grid(x, y, height)
    number = np.arange(x.size).reshape(x.shape)
    rim = np.concatenate([number[:-1, 0], number[-1, :-1], number[:0:-1, -1], number[0, :0:-1]])  # counterclockwise
    # the sides have vertices of their own: Mitsuba's normals are means over all faces around a vertex
    below = top[rim] * (1, 1, 0) + (0, 0, floor)
    high, deep, low = len(top) + np.arange(3 * len(rim)).reshape(3, -1)
    middle = np.full(len(rim), low[-1] + 1)
    following, deep_following, low_following = (np.roll(ring, -1) for ring in (high, deep, low))
    sides = [(high, deep, deep_following), (high, deep_following, following), (low_following, low, middle)]
    vertices = np.concatenate([top, top[rim], below, below, below.mean(axis=0, keepdims=True)])
    return vertices, np.concatenate([faces, *(np.stack(corners, -1) for corners in sides)])


def sea():
    x, y = np.meshgrid(np.linspace(-2.6, 2.6, 161), 0.1 + 4.4 * np.linspace(0, 1, 221) ** 1.6, indexing="ij")
    return closed(x, y, waves(x, y), -0.3)


def dune(width=0.13):
    """A ridge of loose sand before the camera."""
    x, y = np.meshgrid(np.linspace(-0.5, 0.5, 81), np.linspace(-0.3, 0.3, 49), indexing="ij")
    across = np.clip(1 - (2 * x) ** 2 - (y / (0.3 - 0.05 * np.cos(5 * x))) ** 2, 0, None)
    height = (0.2 + 0.07 * np.sin(7 * x + 4 * y) + 0.03 * np.sin(19 * x - 9 * y)) * across**0.8
    vertices, faces = closed(x, y, height + 0.012, 0.0)
    return vertices * width + (-0.02, 0.0, 0.009), faces


SUN = np.array([0.16, 1, 0.17])


def sky(width=64, height=32):
    """Radiance (height, width, 3) around, as a picture that Mitsuba turns upright: warm over the horizon, most below the sun."""
    turn, down = np.meshgrid((np.arange(width) + 0.5) * 2 * math.pi / width, (np.arange(height) + 0.5) * math.pi / height)
    direction = np.stack([np.sin(turn) * np.sin(down), np.cos(turn) * np.sin(down), np.cos(down)], -1)
    up = np.clip(direction[..., 2], 0, 1)[..., None]
    near = (direction @ (SUN / np.linalg.norm(SUN)))[..., None]
    colour = np.array([0.2, 0.28, 0.46]) + (np.array([0.75, 0.5, 0.34]) - [0.2, 0.28, 0.46]) * np.exp(-up / 0.16)
    return (colour + np.array([3.2, 1.6, 0.6]) * np.exp((near - 1) / 0.03)).astype(np.float32)


def beach():
    s = Scene("A beach in the evening.", (400, 300), 48, (0, -0.15, 0.062), (0.02, 0.6, 0.022), rock=(0.05, 0.045, 0.04),
              pebble=(0.3, 0.28, 0.26), shell=(0.75, 0.55, 0.45))
    s.mesh("dry", "beach_dry", matt(0.48, 0.35, 0.22))
    s.mesh("wet", "beach_wet", matt(0.2, 0.14, 0.09))
    s.mesh("sea", "sea", glass(1.33))
    for x, y, radius, up in ((0.9, 2.1, 0.3, -0.1), (1.25, 2.2, 0.4, -0.1), (1.7, 2.4, 0.5, -0.15), (0.62, 1.9, 0.13, -0.05)):
        s.ball("rock", (x, y, up), radius)
    for x, y, radius, bsdf in ((0.075, 0.06, 0.011, "pebble"), (0.1, 0.075, 0.007, "rock"), (-0.1, 0.12, 0.009, "shell"),
                               (0.05, 0.16, 0.006, "rock")):
        s.ball(bsdf, (x, y, 0.012 + 0.3 * radius), radius)
    place = 9 * SUN / np.linalg.norm(SUN)
    s.add(f'<shape type="disk" id="sun"> <transform name="to_world"> <scale value="0.32"/> <lookat origin="{text(place)}" '
          f'target="0, 0, 0" up="0, 0, 1"/> </transform> {shines(25, 15, 7)} </shape>')
    s.add('<emitter type="envmap" id="sky"> <string name="filename" value="beach_sky.exr"/> <transform name="to_world"> '
          '<rotate x="1" angle="90"/> </transform> </emitter>')
    return s


def write_picture(name, values):
    import mitsuba
    mitsuba.set_variant("scalar_rgb")
    mitsuba.Bitmap(values).convert(component_format=mitsuba.Struct.Type.Float16).write(str(HERE / f"{name}.exr"))


SCENES = {"winter_evening": winter, "beach": beach}


def main():
    for name, (vertices, faces) in {"snow_heap": heap(), "snow_cushion": cushion(),
                                    "beach_dry": strip(-1.5, 0, 61), "beach_wet": strip(0, 4.5, 61),
                                    "sea": sea(), "dune": dune()}.items():
        write_mesh(name, vertices, faces)
    write_picture("beach_sky", sky())
    for name, scene in SCENES.items():
        scene().write(name)


if __name__ == "__main__":
    main()
