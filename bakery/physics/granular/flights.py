"""Flights through a periodic tile of spheres.

A flight steps through a grid of cells that list the images of spheres; where it leaves the tile it enters the next copy, whose
number it keeps, so nothing is cut at the tile's faces.  A sphere is known by its number and its copy: what is left out at the
start of a flight is that image, not the sphere.
"""

import math

import numpy as np

from bakery.system.compiled import njit


@njit(nogil=True, error_model="numpy", forceinline=True)
def _walls(cell, edge, o, d):
    """Distance to the first wall between cells along an axis, and from one to the next; inf where nothing moves along it."""
    return (((cell + (d > 0)) * edge - o) / d, edge / abs(d)) if d != 0 else (np.inf, np.inf)


# inlined, so that arrays are not counted in and out at each call: a fifth of the time of a walk among balls
@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def flight_to_sphere(o, d, remaining, grid, limit, cells, to):
    """Distance along unit d (3,) from o (3,), outside of all spheres, to the first sphere; `limit` where none comes before it.

    o : in the frame of the copy left[1:];  remaining : (4,) sphere that the ray has just left, or -1, and the tile's copy
    grid : edges (3,) of the tile, its cells along them (3,), and what `tile_grid` gives of these
    cells : (4,) becomes the sphere and its copy;  to : (3,) becomes the vector from o to its centre
    """
    # no planes: what is asked of them goes while this is compiled
    return flight_in_slab(o, d, remaining, grid, limit, cells, to, (0, np.inf, -np.inf))


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def flight_in_slab(o, d, remaining, grid, limit, cells, to, slab):
    """`flight_to_sphere` among those spheres alone whose centres lie between two planes across the tile's third axis.

    slab : number of a copy along that axis, and the upper and the lower plane in its frame; inf and -inf: there is none
    """
    base, top, bottom = slab
    cell, m, start, image, owner = grid
    h0, h1, h2 = cell[0] / m[0], cell[1] / m[1], cell[2] / m[2]
    skip, far_i, far_j, far_k = remaining[0], remaining[1], remaining[2], remaining[3]
    i, j, k = math.floor(o[0] / cell[0]), math.floor(o[1] / cell[1]), math.floor(o[2] / cell[2])
    ox, oy, oz = o[0] - i * cell[0], o[1] - j * cell[1], o[2] - k * cell[2]
    i, j, k = i + far_i, j + far_j, k + far_k
    dx, dy, dz = d[0], d[1], d[2]
    a, b, c = min(int(ox / h0), m[0] - 1), min(int(oy / h1), m[1] - 1), min(int(oz / h2), m[2] - 1)
    u, v, w = 1 if dx > 0 else -1, 1 if dy > 0 else -1, 1 if dz > 0 else -1
    (wall_x, every_x), (wall_y, every_y), (wall_z, every_z) = _walls(a, h0, ox, dx), _walls(b, h1, oy, dy), _walls(c, h2, oz, dz)
    best = limit
    while True:
        bin_index, lifted = (a * m[1] + b) * m[2] + c, (k - base) * cell[2]
        lowest, highest = bottom - lifted, top - lifted
        for s in range(np.uint64(start[bin_index]), np.uint64(start[bin_index + 1])):
            x, y, z = image[s, 0] - ox, image[s, 1] - oy, image[s, 2] - oz
            along = x * dx + y * dy + z * dz
            # from the distance of the line to the centre: far away, |oc|^2 - along^2 would lose its digits
            p, q, r = x - along * dx, y - along * dy, z - along * dz
            inside = image[s, 3] - (p * p + q * q + r * r)
            # ahead, met, and between the planes: one question, as processors guess each of four wrong as often as not
            if min(min(along, inside), min(highest - image[s, 2], image[s, 2] - lowest)) > 0.0:
                t = max(along - math.sqrt(inside), 0.0)
                if t < best and not (owner[s, 0] == skip and owner[s, 1] + i == far_i and owner[s, 2] + j == far_j
                                     and owner[s, 3] + k == far_k):
                    best = t
                    to[0], to[1], to[2] = x, y, z
                    cells[0], cells[1], cells[2], cells[3] = owner[s, 0], owner[s, 1] + i, owner[s, 2] + j, owner[s, 3] + k
        # the tile repeats: beyond its faces the ray goes on inside, seen from an origin one tile further back
        if wall_x <= wall_y and wall_x <= wall_z:
            if best <= wall_x:
                return best
            wall_x += every_x
            a += u
            if a == m[0] or a < 0:
                a, i, ox = a - u * m[0], i + u, ox - u * cell[0]
        elif wall_y <= wall_z:
            if best <= wall_y:
                return best
            wall_y += every_y
            b += v
            if b == m[1] or b < 0:
                b, j, oy = b - v * m[1], j + v, oy - v * cell[1]
        else:
            if best <= wall_z:
                return best
            wall_z += every_z
            c += w
            if c == m[2] or c < 0:
                c, k, oz = c - w * m[2], k + w, oz - w * cell[2]
