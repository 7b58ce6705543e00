"""Where materials are: regions, which of them a ray is in, and how far it is to the next boundary of one.

The innermost material counts: of the regions around a point the one of the least volume, of equal ones a body.  Nothing is kept
from one flight to the next: origin and direction tell, in double precision, which regions a ray is in.
"""

import math
from typing import NamedTuple

import numpy as np

from bakery import kernels
from bakery.kernels import lent, mesh_scratch, nearest_triangle, triangle_normal
from bakery.system.compiled import njit
from renderers.threads import run
from renderers.transport.solids import SMALLER, volume

# What there is of the scene's surfaces at the boundary of a region: none; one that light does not see (`null`); one that turns
# light, which itself ends a path's flight
FREE, BLIND, TURNS = range(3)
NOWHERE = -1  # in place of a material
_BEFORE = 1e-3  # half diagonals of a mesh that rays from afar are looked at before its box
_OFF = 1e-6  # of the largest coordinate of a region, that a path is put beyond a boundary


class Region(NamedTuple):
    """Of one material.

    layout : `bakery.kernels.Region`; None: everywhere
    volume : m^3
    bounds : FREE, BLIND or TURNS
    solid : whether it holds grains, which stick out and are looked for by themselves
    """

    layout: kernels.Region | None
    volume: float
    bounds: int = FREE
    solid: bool = False

    @property
    def box(self):
        """Corners (2, 3) m of the box around it; None if it is everywhere."""
        return None if self.layout is None else np.array([self.layout.lo, self.layout.hi])


EVERYWHERE = Region(None, math.inf)


def box(lo, hi) -> Region:
    """All of a box, corners (3,) m."""
    return Region(kernels.region_box(lo, hi), float(np.prod(np.asarray(hi, float) - lo)))


def mesh(vertices, faces, bounds=FREE, solid=False) -> Region:
    """The inside of a closed mesh, vertices (V, 3) m and faces (F, 3) wound outward."""
    vertices, faces = np.asarray(vertices, float), np.asarray(faces)
    lo, hi = vertices.min(axis=0), vertices.max(axis=0)
    centre, scale = (lo + hi) / 2, float(np.linalg.norm(hi - lo)) / 2
    nodes, children, blocks = kernels.Mesh((vertices - centre) / scale, faces).tree[:3]
    layout = kernels.region_box(lo, hi)._replace(centre=centre, scale=scale, nodes=nodes, children=children, blocks=blocks)
    return Region(layout, volume(vertices, faces), bounds, solid)


@njit(cache=True, nogil=True, error_model="numpy")
def next_boundary(region, origin, direction, inside, distance, begin, end):
    """Whether rays (n, 3) start in a region, inside (n,), and distance (n,) m to where they next come out of it or into it."""
    region = lent(region)
    lo, hi, scratch = region.lo, region.hi, mesh_scratch()
    c, s, meshed = region.centre, region.scale, region.nodes.size > 1
    for i in range(begin, end):
        inside[i], distance[i] = False, np.inf
        near, far = -np.inf, np.inf
        for k in range(3):
            o, d = origin[i, k], direction[i, k]
            if d == 0.0:
                if not lo[k] <= o <= hi[k]:
                    far = -np.inf
            else:
                a, b = (lo[k] - o) / d, (hi[k] - o) / d
                near, far = max(near, min(a, b)), min(far, max(a, b))
        if meshed:
            near, far = near - _BEFORE * s, far + _BEFORE * s
        if not (near <= far and far > 0.0):
            continue
        if not meshed:
            inside[i] = near <= 0.0
            distance[i] = far if near <= 0.0 else near
            continue
        t = max(near, 0.0)
        dx, dy, dz = direction[i, 0], direction[i, 1], direction[i, 2]
        at, crossing = nearest_triangle(
            region.nodes, region.children, region.blocks, (origin[i, 0] + t * dx - c[0]) / s, (origin[i, 1] + t * dy - c[1]) / s,
            (origin[i, 2] + t * dz - c[2]) / s, dx, dy, dz, np.int64(-1), scratch)
        if at < 0:
            continue
        x, y, z = triangle_normal(region.blocks, at)
        inside[i] = x * dx + y * dy + z * dz > 0.0
        distance[i] = t + crossing * s


class Places:
    """Regions of materials, by their numbers.

    rank : (materials + 1,) of each among the others, the innermost first; the last one is that of no material
    off : m, that a path is put beyond a boundary
    """

    def __init__(self, regions):
        self.regions = list(regions)
        boxes = [region.box for region in self.regions if region.layout is not None]
        self.off = _OFF * float(np.max(np.abs(boxes))) if boxes else 0.0
        ordered = sorted(range(len(self.regions)), key=self._volume)
        self.rank = np.full(len(ordered) + 1, len(ordered))
        self.rank[ordered] = np.arange(len(ordered))
        # grains are found by themselves: their region matters where it keeps a material out
        self._ordered = [number for number in ordered if not self.regions[number].solid or self.around_of(number)]

    def _volume(self, number):
        region = self.regions[number]
        return region.volume if region.bounds == FREE else (1 - SMALLER) * region.volume

    def around_of(self, number) -> list[int]:
        """Materials outside of one that its region may keep out."""
        return [outer for outer in range(len(self.regions)) if self.rank[outer] > self.rank[number] and
                not self.regions[outer].solid and self._meet(number, outer)]

    def within(self, number) -> list[int]:
        """Materials that may be inside of one."""
        return [inner for inner in range(len(self.regions)) if self.rank[inner] < self.rank[number] and self._meet(number, inner)]

    def _meet(self, number, other):
        mine, its = self.regions[number].box, self.regions[other].box
        return mine is None or its is None or bool(np.all((mine[0] <= its[1] + self.off) & (its[0] <= mine[1] + self.off)))

    def find(self, origin, direction):
        """The innermost material around the origins of rays (n, 3), or NOWHERE; distance (n,) m to the next boundary where that
        may change, inf where there is none before a surface that turns light; whether the boundary is BLIND (n,)."""
        n = len(origin)
        material, stop, blind = np.full(n, NOWHERE), np.full(n, np.inf), np.zeros(n, bool)
        open_ones = np.arange(n)  # that are in none of the regions so far
        for number in self._ordered:
            region = self.regions[number]
            if region.layout is None:
                material[open_ones] = number
                break
            inside, distance = np.empty(len(open_ones), bool), np.empty(len(open_ones))
            run(next_boundary, len(open_ones), region.layout, origin[open_ones], direction[open_ones], inside, distance)
            if region.bounds != TURNS:
                nearer = distance < stop[open_ones]
                stop[open_ones[nearer]], blind[open_ones[nearer]] = distance[nearer], region.bounds == BLIND
            material[open_ones[inside]] = number
            open_ones = open_ones[~inside]
        return material, stop, blind
