"""Triangles of files made a solid, or refused with what is wrong and where.

A usable mesh is closed (each edge has two triangles), wound outward, crosses itself nowhere and encloses a volume.  Shells inside
others are cavities and wound inward.  What needs no judgement is done here: equal vertices become one, triangles that stand
there twice go, bodies are wound alike and outward.  Holes and the like are the work of `repair`.

Why not trimesh's groups and graphs, which are as quick and tell the same: its import takes 0.4 s, of every picture with a mesh.
"""

import numpy as np

from bakery.physics.shapes.files import triangles
from bakery.physics.shapes.quality import FACES, area, around, body_volumes, double_normals, self_crossings, tree, volume
from bakery.physics.shapes.solid import arrays, more, point

BODIES = 256
_FLAT = 1e-12  # height over longest side below which a triangle has no normal
_SMALLEST = 1e-30  # size: as `solid.LARGEST`


class Unsound(ValueError):
    """What a repair program may mend."""


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
    Unsound : the same, where `repair.repaired` may help
    """
    mesh = _Mesh(*checked(vertices, faces))
    mesh.weld()
    mesh.drop()
    mesh.outward(mesh.orient())
    return mesh.result()


def closed_mesh(data, kind):
    """Vertices (V, 3) and triangles (F, 3) of a mesh file, a solid with outward normals.

    data : bytes of the file;  kind : its ending, such as ply

    Raises ValueError, in words, where it is no such file, or no closed mesh.
    """
    return solid(*triangles(data, kind))


def solid(vertices, faces):
    """Vertices (V, 3) and triangles (F, 3) of a closed mesh with outward normals, equal vertices made one; as `closed_mesh`."""
    vertices, faces, _ = mended(vertices, faces)
    return vertices, faces


def checked(vertices, faces):
    """Arrays with sane numbers: vertices (V, 3) float64 and faces (F, 3) int32."""
    vertices, faces = arrays(vertices, faces)
    if not size(vertices) > _SMALLEST:
        raise ValueError(f"all vertices lie within {size(vertices):g} of each other")
    return vertices, faces.astype(np.int32)


def size(vertices) -> float:
    """Longest edge of the box around vertices (V, 3)."""
    return float(np.ptp(vertices, axis=0).max())


class _Mesh:
    """Triangles on their way to a usable mesh; `vertex` and `face` are the numbers that the caller knows."""

    def __init__(self, vertices, faces):
        self.v, self.f = vertices, faces
        self.vertex, self.face = np.arange(len(vertices)), np.arange(len(faces))
        self.notes = []

    def weld(self):
        """One vertex where several are equal, to the last bit."""
        first, same = _alike(self.v + 0.0)  # -0 is 0
        order = np.argsort(first)
        merged = len(self.v) - len(first)
        if merged:
            self.notes.append(f"{_count(merged, 'vertices')} merged with others")
            self.v, self.vertex = self.v[first[order]], self.vertex[first[order]]
            self.f = np.argsort(order)[same][self.f].astype(np.int32)

    def drop(self):
        """Without triangles that are a line or a point, and with one of those that stand there twice, or back to back."""
        self._keep(~(self.f == np.roll(self.f, 1, axis=1)).any(axis=1), "with two equal corners removed")
        once = np.zeros(len(self.f), bool)
        once[_alike(np.sort(self.f, axis=1))[0]] = True
        self._keep(once, "removed that stand there twice")
        if not len(self.f):
            raise ValueError("no triangle is left that has three different corners")
        corner = self.v[self.f]
        longest = ((np.roll(corner, -1, axis=1) - corner) ** 2).sum(axis=2).max(axis=1)
        flat = np.flatnonzero((double_normals(self.v, self.f) ** 2).sum(axis=1) <= (_FLAT * longest) ** 2)
        if flat.size:
            raise Unsound(f"face {self.face[flat[0]]} at {self._middle(flat[0])} has no area{more(flat)}")

    def orient(self):
        """All triangles of a body wound alike; the number of each triangle's body (F,)."""
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components

        number = len(self.f)
        (first, second), (of_first, of_second) = self._paired()
        # each triangle stands there as it is and, F later, turned: what must be wound alike is linked
        against = number * (first == second)
        links = np.concatenate([of_first, of_first + number]), np.concatenate([of_second + against, of_second + number - against])
        graph = coo_array((np.ones(len(links[0]), np.int8), links), shape=(2 * number, 2 * number))
        label = connected_components(graph, directed=False)[1].reshape(2, number)
        bad = np.flatnonzero(label[0] == label[1])
        if bad.size:
            raise ValueError(f"no inside and outside: winding cannot be made consistent around face {self.face[bad[0]]} at "
                             f"{self._middle(bad[0])} (a Moebius band?)")
        body, turned = np.unique(label.min(axis=0), return_inverse=True)[1], label[0] > label[1]
        if turned.any():
            turned ^= (np.bincount(body, turned) / np.bincount(body) > 0.5)[body]  # the larger part tells what was meant
            self.f[turned] = self.f[turned][:, ::-1]
            self.notes.append(f"{_count(turned.sum(), 'triangles')} wound against their neighbours turned")
        return body

    def outward(self, body):
        """Bodies wound outward, cavities inward; and no crossings, which would leave that open."""
        volumes = body_volumes(self.v, self.f, body)
        number = len(volumes)
        if number > BODIES:
            raise ValueError(f"{number:,} separate bodies; at most {BODIES} (remove the specks)")
        pairs = self_crossings(tree(self.v, self.f), 100)
        if len(pairs):
            i, j = pairs[0]
            others = f" (and {'at least ' if len(pairs) == 100 else ''}{len(pairs) - 1} more pairs)" if len(pairs) > 1 else ""
            raise ValueError(f"crosses itself: face {self.face[i]} and face {self.face[j]} near {self._middle(i)}{others}")
        cavity = around(self.v, self.f, body) % 2 == 1
        if cavity.any():
            self.notes.append(f"{int(cavity.sum())} of {number} bodies lie inside another: taken as cavities")
        wrong = (volumes < 0) != cavity
        if wrong.any():
            self.f[wrong[body]] = self.f[wrong[body]][:, ::-1]
            self.notes.append("turned inside out" if number == 1 else f"{int(wrong.sum())} of {number} bodies turned inside out")

    def result(self):
        """The mesh without spare vertices, if it encloses something."""
        used, numbers = np.unique(self.f, return_inverse=True)
        if len(used) < len(self.v):
            self.notes.append(f"{_count(len(self.v) - len(used), 'vertices')} without a triangle removed")
        vertices, faces = self.v[used], numbers.reshape(-1, 3).astype(np.int32)
        if len(faces) < FACES[0]:
            raise ValueError(f"{len(faces)} triangles enclose nothing; at least {FACES[0]}")
        held, skin = volume(vertices, faces), area(vertices, faces)
        if not held > 1e-9 * size(vertices) * skin:
            raise ValueError(f"encloses no volume ({held:.3g} within an area of {skin:.3g}): flat")
        return np.ascontiguousarray(vertices), np.ascontiguousarray(faces), tuple(self.notes)

    def _paired(self):
        """Of each edge whether its two triangles go along it from the lower vertex to the higher (2, E), and which they are
        (2, E); Unsound, unless each edge has two."""
        edge, index = np.stack([self.f, np.roll(self.f, -1, axis=1)], axis=2).reshape(-1, 2), np.repeat(np.arange(len(self.f)), 3)
        first, which = _alike(np.sort(edge, axis=1))
        count = np.bincount(which)
        for bad, words in ((count > 2, "meet at"), (count < 2, "alone has")):
            if bad.any():
                k = int(np.argmax(bad))
                named = np.sort(self.face[index[which == k]])
                a, b = edge[first[k]]
                open_ = "" if count[k] > 1 else "not closed: "
                at = f"{count[k]} triangles (faces {', '.join(map(str, named[:6]))})" if count[k] > 1 else f"face {named[0]}"
                raise Unsound(f"{open_}{at} {words} the edge of the vertices {self.vertex[a]} and {self.vertex[b]} at "
                              f"{point(0.5 * (self.v[a] + self.v[b]))}; an edge of a solid has two"
                              f"{more(np.flatnonzero(bad), 'edge')}")
        pair = np.argsort(which, kind="stable").reshape(-1, 2).T
        return (edge[:, 0] < edge[:, 1])[pair], index[pair]

    def _keep(self, keep, words):
        if not keep.all():
            self.notes.append(f"{_count((~keep).sum(), 'triangles')} {words}")
            self.f, self.face = self.f[keep], self.face[keep]

    def _middle(self, i):
        return point(self.v[self.f[i]].mean(axis=0))


def _alike(rows):
    """The first of each kind of equal rows of (N, k), by their values, and the kind (N,) of each."""
    order = np.lexsort(rows.T[::-1])
    begins = np.append(True, (np.diff(rows[order], axis=0) != 0).any(axis=1))
    kind = np.empty(len(rows), np.int64)
    kind[order] = np.cumsum(begins) - 1
    return order[begins], kind


def _count(number, noun):
    singular = {"vertices": "vertex"}.get(noun, noun[:-1])
    return f"{int(number):,} {singular if number == 1 else noun}"
