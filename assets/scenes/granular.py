"""Writes the meshes and grids of the scenes of grains: python assets/scenes/granular.py   (needs manifold3d, of the extra `test`)

All are closed, z is up.  A bowl is what spices lie in; grains fill the others.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1]))

import numpy as np  # noqa: E402
from manifold3d import CrossSection, Manifold  # noqa: E402

from bakery.store import ply  # noqa: E402


def turned(polygons, sides=64):
    """Polygons of radii and heights, counterclockwise, turned about the axis z; where they overlap they are one."""
    return Manifold.revolve(CrossSection(polygons), sides)


def box(low, high):
    return Manifold.cube(np.subtract(high, low).tolist()).translate(low)


def union(parts):
    return sum(parts, Manifold())


def cube():
    """Edge 1, on the plane z = 0."""
    return box((-0.5, -0.5, 0), (0.5, 0.5, 1))


def snowman():
    """Three balls that grew together, 1 high, cut off by the plane z = 0."""
    angles = np.linspace(-math.pi / 2, math.pi / 2, 25)
    balls = (0.2, 0.26), (0.565, 0.19), (0.855, 0.145)  # height of the centre, radius
    profiles = [[(radius * math.cos(a), height + radius * math.sin(a)) for a in angles] for height, radius in balls]
    return turned(profiles, 48).trim_by_plane((0, 0, 1), 0)


# ---- the castle

TALL, WALL, TOOTH = 0.62, 0.4, 0.08  # heights of towers and walls, of a tooth of the battlements


def tower(radius, height, teeth):
    """A round tower that gets narrower, with battlements."""
    top = 0.86 * radius
    body = Manifold.cylinder(height, radius, top, 40)
    hole = Manifold.cylinder(1, 0.8 * top, 0.8 * top, 40).translate((0, 0, 0.05))
    crown = Manifold.cylinder(0.05 + TOOTH, 1.12 * top, 1.12 * top, 40) - hole
    gap = box((0, -0.32 * top, 0.05), (2 * top, 0.32 * top, 1))
    crown -= union(gap.rotate((0, 0, (k + 0.5) * 360 / teeth)) for k in range(teeth))
    return body + crown.translate((0, 0, height))


def wall(length, teeth):
    """Along x, with battlements on its outside, which is -y; thicker at its foot."""
    foot, walk = 0.075, 0.055
    corners = [(-foot, 0), (foot, 0), (walk, WALL), (-walk, WALL)]
    body = CrossSection([corners]).extrude(length).rotate((90, 0, 90)).translate((-length / 2, 0, 0))
    wide = length / (2 * teeth + 1)
    return body + union(box((x, -walk, WALL - 0.01), (x + wide, -walk + 0.045, WALL + TOOTH))
                        for x in -length / 2 + wide * (1 + 2 * np.arange(teeth)))


def castle():
    """Four towers, walls with battlements, a gate and a keep on a slab; 2 wide."""
    at = 0.7
    parts = [tower(0.2, TALL, 6).translate((sx * at, sy * at, 0)) for sx in (-1, 1) for sy in (-1, 1)]
    parts += [wall(2 * at, 6).translate((0, -at, 0)).rotate((0, 0, 90 * k)) for k in range(4)]
    gate = box((-0.26, -0.84, 0), (0.26, -0.56, 0.52)) + union(
        box((x, -0.84, 0.5), (x + 0.09, -0.56, 0.6)) for x in (-0.26, -0.045, 0.17))
    way = box((-0.12, -1, 0), (0.12, 0, 0.2)) + Manifold.cylinder(1, 0.12, 0.12, 24).rotate((90, 0, 0)).translate((0, 0, 0.2))
    keep = tower(0.3, 0.85, 8) + tower(0.17, 1.12, 5)
    whole = (union(parts) + gate - way.translate((0, -0.2, 0))) + keep
    slab = Manifold.cylinder(0.12, 1.18, 1.1, 48)
    return whole.translate((0, 0, 0.1)) + slab


# ---- bowls

def hollow(count):
    """The inside of a bowl whose opening has the radius 1, from its middle to its rim."""
    angles = np.linspace(0, math.pi / 2, count)
    return [(math.sin(a), 0.65 - 0.57 * math.cos(a)) for a in angles]


def bowl():
    inside, foot = hollow(16), [(0, 0), (0.45, 0), (0.47, 0.06)]
    return turned([[*foot, *((1.06 * r, h - 0.04 * (1 - r)) for r, h in inside[8:]), *inside[::-1]]])


# where four bowls stand, in units of their radius
PLACES = (-1.18, -0.75), (0.98, -1.1), (-0.95, 1.4), (1.25, 1.12)


def spice(place):
    """What fills such a bowl, with a mound; all four differ."""
    phase = 2 * place[0] + place[1]
    inside = [(0.97 * r, h + 0.02) for r, h in hollow(12)]
    mound = [(0.97 * r, 0.67 + 0.4 * (1 - r * r) ** 1.2) for r in np.linspace(1, 0, 14)[1:]]

    def dented(place):
        x, y, z = np.asarray(place).T
        above = np.maximum(z - 0.68, 0)
        return np.stack([x, y, z + 0.12 * above * np.sin(3.1 * x + phase) * np.sin(3.7 * y + 2 * phase)], 1)

    return turned([[*inside, *mound]], 40).warp_batch(dented).translate((*place, 0))


# ---- two halves of a mound

def mound(side):
    """Half of a flat mound of radius 1, that of side * x >= 0: the two touch in the plane x = 0."""
    profile = [(0, 0), *((r, 0.02 + 0.4 * (1 - r**1.6)) for r in np.linspace(1, 0, 17))]
    profile.insert(1, (1, 0))

    def dented(place):
        x, y, z = np.asarray(place).T
        return np.stack([x, y, z * (1 + 0.15 * np.sin(4 * x + 1) * np.cos(5 * y))], 1)

    return turned([profile], 64).warp_batch(dented).trim_by_plane((side, 0, 0), 0)


# ---- a heap

REPOSE = math.radians(33)  # dry sand's angle of repose
ROUND, FOOT = 0.1, 0.025  # in radii of the heap: width over which its top is round; height at its rim, a layer of grains


def heap():
    """What was poured from above: slopes at the angle of repose, a rounded top, a foot that is not quite round; radius 1.

    It ends with a layer of grains.  Thinner, it would hold the few grains whose centres are in it, strewn around the heap.
    """
    r = np.linspace(1, 0, 41)
    z = FOOT + math.tan(REPOSE) * (math.hypot(1, ROUND) - np.hypot(r, ROUND))
    profile = [(0, 0), (1, 0), *zip(r, z)]

    def worn(place):
        x, y, z = np.asarray(place).T
        angle, rise = np.arctan2(y, x), np.hypot(x, y)
        wider = 1 + np.minimum(rise, 0.5) * (0.06 * np.sin(2 * angle + 0.5) + 0.04 * np.sin(3 * angle + 2) + 0.02 * np.sin(7 * angle))
        return np.stack([x * wider + 0.05 * z, y * wider, z], 1)

    return turned([profile], 96).warp_batch(worn)


# ---- layers of sand

HIGH, LOOSE = 1.7, 0.5  # height of the sand in radii of its column, and of its loose top


def column():
    """What sand of radius 1 fills, with a mound."""
    profile = [(0, 0), (1, 0), *((r, HIGH - 0.12 + 0.12 * math.cos(math.pi * r)) for r in np.linspace(1, 0, 17))]
    return turned([profile], 64)


def layers():
    """Grids of the column: whether sand at a place (X, Y, Z) is of a colour, and its packing fraction (1, 1, Z)."""
    x, y, z = np.meshgrid(*(np.linspace(-1, 1, 2 * n + 1)[1::2] for n in (40, 12, 64)), indexing="ij")
    height = (z + 1) / 2 * HIGH + 0.09 * np.sin(3.2 * x + 1.1 * y) + 0.05 * np.cos(5.1 * x - 2 * y + 1)
    upto = np.array([0.2, 0.5, 0.62, 0.9, 1.0, 1.22, 1.36])  # tops of the layers
    colour = np.array(["teal", "ochre", "white", "red", "white", "teal", "ochre", "red"])[np.searchsorted(upto, height)]
    level = np.linspace(0, HIGH, 2 * 64 + 1)[1::2]
    fraction = np.interp(level, [HIGH - LOOSE, HIGH], [0.6, 0.02]).reshape(1, 1, -1)
    grids = {name: (colour == name).astype(np.uint8) for name in ("ochre", "red", "teal")}
    return grids | {"fraction": fraction.astype(np.float32)}


def write(name, solid):
    made = solid.to_mesh64()
    (HERE / f"{name}.ply").write_bytes(ply.mesh(made.vert_properties, made.tri_verts, single=True))


def main():
    spices = {f"spice_{k + 1}": spice(place) for k, place in enumerate(PLACES)}
    for name, solid in {"cube": cube(), "snowman": snowman(), "sand_castle": castle(), "bowl": bowl(), **spices,
                        "heap": heap(), "mound_left": mound(-1), "mound_right": mound(1), "column": column()}.items():
        write(name, solid)
    for name, values in layers().items():
        np.save(HERE / f"layers_{name}.npy", values)


if __name__ == "__main__":
    main()
