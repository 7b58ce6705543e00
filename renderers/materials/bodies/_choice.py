"""Which beams a line of sight is joined with: a few, drawn in proportion to a guess of what each would bring it.

Beams that lie near each other form clusters.  From afar a cluster counts as one, and of its beams one is drawn by its strength.
"""

import math
from typing import NamedTuple

import numpy as np

from bakery.system.compiled import njit

_FAN = 3  # 2^_FAN clusters of a level, or beams, form a cluster of the next
_FLOOR = 0.05  # share of the beams that is drawn by their power alone: none is left out where the guess is too low
_ANYWAY = 0.2  # share of the guess that does not hang on directions
_TOGETHER, _APART, _ALIKE = 64, 4.0, 0.8  # lines of sight, mfp, cosine: at most and least, of those that draw beams by one guess
_SOFT = 0.5  # mfp, distance below which nearer beams are not drawn more often
_OPEN, _LESS = 0.7, 0.3  # logarithm of how much a guess may vary in a cluster that counts as one; the less it matters, the more


class Clusters(NamedTuple):
    """N beams at one wavelength, and clusters of 8, 64, ... of them; cluster c of a level holds beams from c 8^level on.

    middle, way : (3, N) m, where beams are strongest, and their directions
    strength : (N,) of each;  before : (N + 1,) of all before
    begin : (levels + 1,) where clusters of each level begin; a beam is of level 0, which holds none
    centre, mean : (3, C) m, of the middles in each cluster, and of their directions, weighted by strength
    radius : (C,) m, within which they lie
    """

    middle: np.ndarray
    way: np.ndarray
    strength: np.ndarray
    before: np.ndarray
    begin: np.ndarray
    centre: np.ndarray
    mean: np.ndarray
    radius: np.ndarray


def clusters_of(sigma, w, beams) -> Clusters:
    """Clusters of beams (`_gather.Beams`, neighbours one after another) at wavelength w; sigma 1/m."""
    n, counts = len(beams.length), [0, 0]
    size = 1 << _FAN
    while size < 8 * n:
        counts.append(-(-n // size))
        size <<= _FAN
    begin = np.cumsum(counts)
    clusters = Clusters(np.empty((3, n)), np.empty((3, n)), np.empty(n), np.zeros(n + 1), begin, np.empty((3, begin[-1])),
                     np.empty((3, begin[-1])), np.empty(begin[-1]))
    _fill(sigma, w, beams, clusters)
    return clusters


@njit(cache=True, nogil=True, error_model="numpy")
def _fill(sigma, w, beams, clusters):
    n = len(beams.length)
    for b in range(n):
        s = min(1.0 / sigma, 0.5 * beams.length[b])
        for k in range(3):
            clusters.middle[k, b], clusters.way[k, b] = beams.origin[b, k] + s * beams.direction[b, k], beams.direction[b, k]
        # a short beam has little power to scatter
        clusters.strength[b] = abs(beams.power[b, w]) * min(1.0, sigma * beams.length[b])
        clusters.before[b + 1] = clusters.before[b] + clusters.strength[b]
    for level in range(1, len(clusters.begin) - 1):
        for c in range(clusters.begin[level], clusters.begin[level + 1]):
            _summed(clusters, c, *_held(clusters, level, c))


@njit(cache=True, nogil=True, error_model="numpy")
def _summed(clusters, c, low, high):
    whole = clusters.before[high] - clusters.before[low]
    for k in range(3):
        centre, mean = 0.0, 0.0
        for b in range(low, high):
            centre += clusters.middle[k, b]
            mean += clusters.strength[b] * clusters.way[k, b]
        clusters.centre[k, c], clusters.mean[k, c] = centre / (high - low), mean / whole if whole > 0.0 else 0.0
    largest = 0.0
    for b in range(low, high):
        square = 0.0
        for k in range(3):
            square += (clusters.middle[k, b] - clusters.centre[k, c]) ** 2
        largest = max(largest, square)
    clusters.radius[c] = math.sqrt(largest)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _held(clusters, level, c):
    """Beams of a cluster: from, to."""
    low = (c - clusters.begin[level]) << (_FAN * level)
    return low, min(low + (1 << (_FAN * level)), len(clusters.strength))


@njit(cache=True, nogil=True, error_model="numpy")
def grouped(origin, direction, far, sigma, around):
    """Groups of lines of sight that see much the same, one after the other: their number, and where they begin, into around.

    sigma : 1/m;  around : (n + 1,)
    """
    count, first = 0, 0
    for i in range(len(far)):
        new = i == 0 or i - first >= _TOGETHER
        if not new:
            square, cosine = 0.0, 0.0
            for k in range(3):
                square += (origin[i, k] - origin[first, k]) ** 2
                cosine += direction[i, k] * direction[first, k]
            new = sigma * sigma * square > _APART * _APART or cosine < _ALIKE
        if new:
            around[count], first = i, i
            count += 1
    around[count] = len(far)
    return count


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _brings(r, ahead, back, k0, g):
    """Guess of what light brings to a distance of r mfp, by the cosine of its direction to the way there, and to that from there
    to the eye."""
    far, near = k0 * r, r + _SOFT
    # light keeps its direction the less, the farther it has come: two Henyey-Greenstein lobes, of the way and of the view
    lobe = g * g / (1 + (1 - g) * r)
    from_source, to_eye = 1 + lobe * lobe - 2 * lobe * ahead, 1 + lobe * lobe - 2 * lobe * back
    spread = (1 - lobe * lobe) / (from_source * to_eye)
    lobes = _ANYWAY + (1 - _ANYWAY) * spread * math.sqrt(spread * (1 - lobe * lobe))
    # 1 / exp(far), as far as it matters
    return lobes * (near + 1) / (near * near * (1 + far * (1 + far * (0.5 + far * (1 / 6 + far / 24)))))


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc", "arcp"})
def _one_by_one(clusters, low, high, light, here, view, total, count):
    """Guesses of beams low to high, into total from count on."""
    sigma, k0, g = light
    ex, ey, ez, vx, vy, vz = here[0], here[1], here[2], view[0], view[1], view[2]
    for b in range(low, high):
        x, y, z = ex - clusters.middle[0, b], ey - clusters.middle[1, b], ez - clusters.middle[2, b]
        px, py, pz = clusters.way[0, b], clusters.way[1, b], clusters.way[2, b]
        r = sigma * math.sqrt(x * x + y * y + z * z)
        ahead = sigma / (r + _SOFT) * (x * px + y * py + z * pz)
        total[count + b - low] = clusters.strength[b] * _brings(r, ahead, -(vx * px + vy * py + vz * pz), k0, g)


@njit(cache=True, nogil=True, error_model="numpy")
def guess(clusters, light, here, view, items, total):
    """Guesses of what beams bring to a place against a line of sight, and how many; cumulated, into total.

    light : 1/m, extinction; decay of diffuse light over that; mean cosine of the phase function
    here, view : (3,) m, and direction of the line of sight
    items : (N + 1,) becomes the first beam of each item, a beam or a cluster, and N at the end
    total : (N,) becomes cumulated guesses
    """
    sigma, k0, g = light
    n, count, beam = len(clusters.strength), 0, 0
    top = len(clusters.begin) - 2
    level = top
    while beam < n:
        c = clusters.begin[level] + (beam >> (_FAN * level))
        x, y, z = here[0] - clusters.centre[0, c], here[1] - clusters.centre[1, c], here[2] - clusters.centre[2, c]
        r, radius = sigma * math.sqrt(x * x + y * y + z * z), sigma * clusters.radius[c]
        low, high = _held(clusters, level, c)
        if radius * (2 / (r + _SOFT) + k0 / (1 + k0 * r * _LESS)) < _OPEN:
            px, py, pz = clusters.mean[0, c], clusters.mean[1, c], clusters.mean[2, c]
            ahead = sigma / (r + _SOFT) * (x * px + y * py + z * pz)
            back = -(view[0] * px + view[1] * py + view[2] * pz)
            total[count] = (clusters.before[high] - clusters.before[low]) * _brings(r, ahead, back, k0, g)
            items[count] = low
            count += 1
        elif level == 1:
            _one_by_one(clusters, low, high, light, here, view, total, count)
            for b in range(low, high):
                items[count] = b
                count += 1
        else:
            level -= 1
            continue
        beam = high
        while level < top and not beam & ((1 << (_FAN * (level + 1))) - 1):
            level += 1
    items[count] = n
    whole = 0.0
    for e in range(count):
        whole += total[e]
        total[e] = whole
    return count


@njit(cache=True, nogil=True, error_model="numpy")
def drawn(clusters, items, total, count, u):
    """A beam drawn with the number u, and its probability; 0 where no beam brings anything."""
    whole, power = total[count - 1] if count > 0 else 0.0, clusters.before[-1]
    if not whole > 0.0:
        return 0, 0.0
    if u < _FLOOR:
        beam = _within(clusters, 0, len(clusters.strength), u / _FLOOR)
        e = np.searchsorted(items[:count], beam, side="right") - 1
        before = total[e - 1] if e > 0 else 0.0
    else:
        u = (u - _FLOOR) / (1 - _FLOOR) * whole
        e = min(np.searchsorted(total[:count], u, side="right"), count - 1)
        before = total[e - 1] if e > 0 else 0.0
        beam = _within(clusters, items[e], items[e + 1], (u - before) / (total[e] - before))
    share, strength = (total[e] - before) / whole, clusters.strength[beam]
    held = clusters.before[items[e + 1]] - clusters.before[items[e]]
    return beam, _FLOOR * strength / power + (1 - _FLOOR) * share * strength / held if strength > 0.0 else 0.0


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _within(clusters, low, high, u):
    """A beam from low to high drawn by its strength."""
    u = clusters.before[low] + u * (clusters.before[high] - clusters.before[low])
    return min(max(low + np.searchsorted(clusters.before[low:high + 1], u, side="right") - 1, low), high - 1)
