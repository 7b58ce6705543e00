"""Triangles of files made a solid: what can be mended safely is mended and reported, the rest is refused with its place.

A usable mesh is closed (each edge has two triangles), wound outward, crosses itself nowhere and encloses a volume.  Shells inside
others are cavities and wound inward.
"""

from __future__ import annotations

import numpy as np

from bakery.physics.shapes.lines import inside, tree
from bakery.physics.shapes.quality import FACES, area, bodies, double_normals, edges, key, neighbours, self_crossings, volume

BODIES = 256
HOLE_EDGES, HOLE_AREA = 64, 0.1  # largest hole that is closed: edges of its rim, share of the surface
_WELD = 1e-9, 1e-6  # of the size: vertices that are one; the same on the rims of holes
_FLAT = 1e-12  # height over longest side below which a triangle has no normal
_RANGE = 1e-30, 1e30  # smallest size and largest coordinate: fourth powers must not leave the range of numbers


def mended(vertices, faces):
    """A usable mesh from triangles as files hold them.

    Parameters
    ----------
    vertices : (V, 3) any length
    faces : (F, 3) indices of vertices

    Returns
    -------
    vertices : (V', 3) float64
    faces : (F', 3) int32, outward
    notes : tuple of texts: what was changed

    Raises
    ------
    ValueError : what is wrong and where, with vertices and faces numbered from 0 as they were given

    Notes
    -----
    Mended: equal vertices (and, where holes or flat triangles remain, those closer than 1e-9 of the size, on rims of holes 1e-6),
    triangles without area, duplicates, winding, holes of up to 64 edges and 10 % of the surface.
    """
    vertices, faces = _numbers(vertices, faces)
    repair = _Repair(vertices, faces)
    repair.weld(0.0)
    repair.drop()
    repair.weld_rims()
    repair.orient()
    repair.flatten()
    repair.close()
    repair.outward()
    return repair.result()


def _numbers(vertices, faces):
    """Arrays with sane numbers."""
    vertices, faces = np.array(vertices, float, ndmin=2), np.array(faces, ndmin=2)
    if vertices.shape[1:] != (3,) or faces.shape[1:] != (3,) or not np.issubdtype(faces.dtype, np.integer):
        raise ValueError("a mesh is vertices (V, 3) and triangles (F, 3) of whole numbers")
    if len(faces) > FACES[1]:
        raise ValueError(f"{len(faces):,} triangles; at most {FACES[1]:,} (simplify it first)")
    bad = np.flatnonzero(~np.isfinite(vertices).all(axis=1) | (np.abs(vertices) > _RANGE[1]).any(axis=1))
    if bad.size:
        raise ValueError(f"vertex {bad[0]} is {_point(vertices[bad[0]])}; coordinates are finite numbers up to {_RANGE[1]:g}"
                         f"{_more(bad)}")
    bad = np.flatnonzero((faces < 0).any(axis=1) | (faces >= len(vertices)).any(axis=1))
    if bad.size:
        raise ValueError(f"face {bad[0]} names the vertices {faces[bad[0]].tolist()}, but there are only {len(vertices):,} (0 to "
                         f"{len(vertices) - 1}){_more(bad)}")
    return vertices, faces.astype(np.int32)


class _Repair:
    """Triangles on their way to a usable mesh; `vertex` and `face` are the numbers that the caller knows."""

    def __init__(self, vertices, faces):
        self.v, self.f = vertices, faces
        self.vertex, self.face = np.arange(len(vertices)), np.arange(len(faces))
        self.notes = []
        self._sorted = None
        low, high = vertices.min(axis=0, initial=np.inf), vertices.max(axis=0, initial=-np.inf)
        self.size = float((high - low).max()) if len(vertices) else 0.0
        if len(faces) and not self.size > _RANGE[0]:
            raise ValueError(f"all vertices lie within {self.size:g} of each other")

    def weld(self, distance, only=None):
        """One vertex where several are closer than a share of the size."""
        if distance == 0:
            first, same = _distinct(self.v)
        else:
            first, same = _clusters(self.v, distance * self.size, only)
        gone = len(self.v) - len(first)
        if gone:
            within = f" within {distance:g} of the size" if distance else ""
            self.notes.append(f"{_count(gone, 'vertices')} merged with others{within}")
            self.v, self.vertex, self.f = self.v[first], self.vertex[first], same[self.f].astype(np.int32)
            self._sorted = None

    def drop(self):
        """Without triangles that are a line, that stand there twice, or back to back."""
        collapsed = (self.f == np.roll(self.f, 1, axis=1)).any(axis=1)
        self._keep(~collapsed, "with two equal corners removed")
        ordered = np.sort(self.f, axis=1)
        order = np.lexsort(ordered.T[::-1])
        s = ordered[order]
        group = np.concatenate([[0], np.cumsum((s[1:] != s[:-1]).any(axis=1))]) if len(s) else np.zeros(0, int)
        number = np.bincount(group)
        if (number > 1).any():
            start = np.cumsum(number) - number
            first = (self.f == ordered[:, :1]).argmax(axis=1)
            following = np.take_along_axis(self.f, (first[:, None] + 1) % 3, axis=1)[:, 0]
            net = np.bincount(group, np.where(following == ordered[:, 1], 1, -1)[order])
            # back to back: a wall inside where both neighbours stand on its edges already, else a sheet with two sides
            sides = edges(s[start], len(self.v))
            crowded = np.zeros(3 * len(start), bool)
            crowded[sides[1]] = np.repeat(sides[2] > 2, sides[2])
            keep = np.zeros(len(s), bool)
            keep[start[(net != 0) | ~crowded.reshape(-1, 3).any(axis=1)]] = True
            kept = np.zeros(len(self.f), bool)
            kept[order] = keep
            self._keep(kept, "removed that stand there twice")
        if not len(self.f):
            raise ValueError("no triangle is left that has three different corners")

    def weld_rims(self):
        """Vertices closer than rounding, where that may close holes or take away triangles without a normal."""
        if self._open().size or self._flat().size:
            self.weld(_WELD[0])
            self.drop()
        rim = self._open()
        if rim.size:
            a, b = self._ends(rim)
            self.weld(_WELD[1], np.unique([a, b]))
            self.drop()

    def flatten(self):
        """Triangles with a corner on their longest side: that side is turned to the corner across it."""
        turned = 0
        for _ in range(8):
            flat = self._flat()
            if not flat.size:
                break
            turned += self._turn(flat)
        if turned:
            self.notes.append(f"{_count(turned, 'triangles')} without area turned away")
        flat = self._flat()
        if flat.size:
            raise ValueError(f"face {self.face[flat[0]]} at {self._middle(flat[0])} has no area and cannot go{_more(flat)}")

    def orient(self):
        """All triangles of a body wound alike."""
        from bakery.physics.shapes._triangles import oriented

        edge, order, count = self._edges()
        if count.max() > 2:
            k = np.flatnonzero(count > 2)
            a, b = self._ends(edge[k[0]])
            start = np.cumsum(count)[k[0]] - count[k[0]]
            named = self.face[order[start:start + count[k[0]]] // 3]
            raise ValueError(f"{count[k[0]]} triangles (faces {', '.join(map(str, np.sort(named)[:6]))}) meet at the edge of "
                             f"the vertices {self.vertex[a]} and {self.vertex[b]} at {_point(0.5 * (self.v[a] + self.v[b]))}; an "
                             f"edge of a solid has two{_more(k, 'edge')}")
        neighbour, against = neighbours(self.f, order, count)
        body, turned, bad = oriented(neighbour, against)
        if bad >= 0:
            raise ValueError(f"no inside and outside: winding cannot be made consistent around face {self.face[bad]} at "
                             f"{self._middle(bad)} (a Moebius band?)")
        if turned.any():
            # the larger part of each body tells what was meant
            share = np.bincount(body, turned) / np.bincount(body)
            turned ^= share[body] > 0.5
            self.f[turned] = self.f[turned][:, ::-1]
            self.notes.append(f"{_count(turned.sum(), 'triangles')} wound against their neighbours turned")

    def close(self):
        """Small holes closed by the triangles of least area on their rims."""
        rim = self._open()
        if not rim.size:
            return
        added, whole = [], area(self.v, self.f)
        for loop in self._rims(rim):
            if len(loop) > HOLE_EDGES:
                raise ValueError(f"not closed: a hole of {len(loop)} edges {self._place(loop)}; up to {HOLE_EDGES} are closed")
            patch = _least_patch(self.v[loop])
            if area(self.v[loop], patch) > HOLE_AREA * whole:
                raise ValueError(f"not closed: a hole {self._place(loop)} is more than {HOLE_AREA:.0%} of the surface")
            added.append(np.asarray(loop)[patch])
        extra = np.concatenate(added).astype(np.int32)
        self.notes.append(f"{_count(len(added), 'holes')} closed with {_count(len(extra), 'triangles')}")
        self.f = np.concatenate([self.f, extra])
        self.face, self._sorted = np.concatenate([self.face, np.full(len(extra), -1)]), None
        if (self._edges()[2] != 2).any() or self._flat().size:
            raise ValueError(f"not closed: a hole {self._place(self._loops[0])} cannot be closed without damage")

    def outward(self):
        """Bodies wound outward, cavities inward; and no crossings, which would leave that open."""
        body, own = bodies(self.v, self.f, *self._edges()[1:])
        number = len(own)
        if number > BODIES:
            raise ValueError(f"{number:,} separate bodies; at most {BODIES} (remove the specks)")
        mesh = tree(self.v, self.f)
        pairs = self_crossings(mesh, 100)
        if len(pairs):
            i, j = pairs[0]
            more = f" (and {'at least ' if len(pairs) == 100 else ''}{len(pairs) - 1} more pairs)" if len(pairs) > 1 else ""
            raise ValueError(f"crosses itself: {self._name(i)} and {self._name(j)} near {self._middle(i)}{more}")
        cavity = np.zeros(number, bool)
        if number > 1:
            first = np.unique(body, return_index=True)[1]
            cavity = inside(mesh, self.v[self.f[first, 0]], body, np.arange(number, dtype=np.int32))
            if cavity.any():
                self.notes.append(f"{int(cavity.sum())} of {number} bodies lie inside another: taken as cavities")
        wrong = (own < 0) != cavity
        if wrong.any():
            self.f[wrong[body]] = self.f[wrong[body]][:, ::-1]
            self.notes.append("turned inside out" if number == 1 else f"{int(wrong.sum())} of {number} bodies turned inside out")

    def result(self):
        """The mesh without spare vertices, if it encloses something."""
        used, numbers = np.unique(self.f, return_inverse=True)
        if len(used) < len(self.v):
            self.notes.append(f"{_count(len(self.v) - len(used), 'vertices')} without a triangle removed")
        self.v, self.f = self.v[used], numbers.reshape(-1, 3).astype(np.int32)
        if len(self.f) < FACES[0]:
            raise ValueError(f"{len(self.f)} triangles enclose nothing; at least {FACES[0]}")
        held, skin = volume(self.v, self.f), area(self.v, self.f)
        if not held > 1e-9 * self.size * skin:
            raise ValueError(f"encloses no volume ({held:.3g} within an area of {skin:.3g}): flat")
        return np.ascontiguousarray(self.v), np.ascontiguousarray(self.f), tuple(self.notes)

    def _keep(self, keep, what):
        if not keep.all():
            self.notes.append(f"{_count((~keep).sum(), 'triangles')} {what}")
            self.f, self.face, self._sorted = self.f[keep], self.face[keep], None

    def _edges(self):
        """Undirected edges (E,) as keys, the sides of triangles in the order of their edges, and how many each edge has."""
        if self._sorted is None:
            self._sorted = edges(self.f, len(self.v))
        return self._sorted

    def _open(self):
        """Edges with one triangle, by key."""
        edge, _, count = self._edges()
        return edge[count == 1]

    def _ends(self, key):
        return key // len(self.v), key % len(self.v)

    def _flat(self):
        corner = self.v[self.f]
        side = np.roll(corner, -1, axis=1) - corner
        longest = (side**2).sum(axis=2).max(axis=1)
        return np.flatnonzero((double_normals(self.v, self.f) ** 2).sum(axis=1) <= (_FLAT * longest) ** 2)

    def _turn(self, flat):
        """Triangle (a, b, c) with b on the side c a, whose other triangle is (a, c, d): now (a, b, d) and (b, c, d)."""
        side = {}
        for i, (a, b, c) in enumerate(self.f.tolist()):
            side[a, b], side[b, c], side[c, a] = i, i, i
        done = 0
        for i in flat.tolist():
            corner = self.v[self.f[i]]
            length = ((np.roll(corner, -1, axis=0) - corner) ** 2).sum(axis=1)
            c, a, b = np.roll(self.f[i], -int(np.argmax(length))).tolist()
            j = side.get((a, c))
            if j is None or side.get((c, a)) != i:
                continue
            d = next(x for x in self.f[j].tolist() if x not in (a, c))
            if d == b or (b, d) in side or (d, b) in side:
                continue
            self.f[i], self.f[j] = (a, b, d), (b, c, d)
            del side[c, a], side[a, c]
            side[a, b], side[b, d], side[d, a] = i, i, i
            side[b, c], side[c, d], side[d, b] = j, j, j
            done += 1
        self._sorted = None
        return done

    def _rims(self, rim):
        """Rims of holes as loops of vertices, in the order in which new triangles must run."""
        a, b = self.f.ravel(), np.roll(self.f, -1, axis=1).ravel()
        lone = np.isin(key(np.minimum(a, b), np.maximum(a, b), len(self.v)), rim)
        follow = {}
        for start, end in zip(b[lone].tolist(), a[lone].tolist(), strict=True):
            if start in follow:
                raise ValueError(f"not closed: holes meet in vertex {self.vertex[start]} at {_point(self.v[start])}")
            follow[start] = end
        loops = []
        while follow:
            start, at = follow.popitem()
            loop = [start]
            while at != start:
                loop.append(at)
                at = follow.pop(at)
            loops.append(loop)
        loops.sort(key=lambda loop: (-len(loop), min(loop)))
        self._loops = loops
        return loops

    def _place(self, loop):
        more = f" (and {len(self._loops) - 1:,} more)" if len(self._loops) > 1 else ""
        return f"at {_point(self.v[loop].mean(axis=0))}, vertices {', '.join(str(self.vertex[i]) for i in loop[:4])} …{more}"

    def _middle(self, i):
        return _point(self.v[self.f[i]].mean(axis=0))

    def _name(self, i):
        return f"face {self.face[i]}" if self.face[i] >= 0 else "a closed hole"


def _distinct(vertices):
    """First of each set of equal vertices, in order, and for each vertex its place among them."""
    bits = (vertices + 0.0).view(np.uint64)  # + 0.0: -0 is 0
    code = bits[:, 0] * np.uint64(0x9E3779B97F4A7C15) + bits[:, 1]
    code = (code ^ code >> np.uint64(29)) * np.uint64(0xBF58476D1CE4E5B9) + bits[:, 2]
    code = (code ^ code >> np.uint64(32)) * np.uint64(0x94D049BB133111EB)
    _, first, same = np.unique(code, return_index=True, return_inverse=True)
    if (vertices[first[same]] != vertices).any():  # two points with one code: sort the numbers themselves
        _, first, same = np.unique(vertices + 0.0, axis=0, return_index=True, return_inverse=True)
    rank = np.argsort(first)
    place = np.empty(len(first), np.int64)
    place[rank] = np.arange(len(first))
    return first[rank], place[same.ravel()]


def _clusters(vertices, distance, only):
    """As `_distinct`, for vertices (of `only`) that are closer than a distance, or linked by others that are."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    chosen = np.arange(len(vertices)) if only is None else only
    pairs = chosen[cKDTree(vertices[chosen]).query_pairs(distance, output_type="ndarray")]
    links = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(vertices),) * 2)
    label = connected_components(links, directed=False)[1]
    _, first, same = np.unique(label, return_index=True, return_inverse=True)
    return first, same


def _least_patch(rim):
    """Triangulation (n - 2, 3) of a loop of points (n, 3) with the least area (Barequet & Sharir 1995)."""
    n = len(rim)
    cost, split = np.zeros((n, n)), np.zeros((n, n), int)
    for gap in range(2, n):
        for i in range(n - gap):
            k = i + gap
            m = np.arange(i + 1, k)
            added = np.sqrt((np.cross(rim[m] - rim[i], rim[k] - rim[i]) ** 2).sum(axis=1))
            total = cost[i, m] + cost[m, k] + added
            best = int(np.argmin(total))
            cost[i, k], split[i, k] = total[best], m[best]
    triangles, pending = [], [(0, n - 1)]
    while pending:
        i, k = pending.pop()
        if k - i >= 2:
            m = int(split[i, k])
            triangles.append((i, m, k))
            pending += [(i, m), (m, k)]
    return np.array(triangles)


def _count(number, what):
    one = {"vertices": "vertex"}.get(what, what[:-1])
    return f"{int(number):,} {one if number == 1 else what}"


def _point(p):
    return "(" + ", ".join(f"{x:.6g}" for x in p) + ")"


def _more(bad, what="place"):
    return f" (and {len(bad) - 1:,} more {what}{'s' if len(bad) > 2 else ''})" if len(bad) > 1 else ""
