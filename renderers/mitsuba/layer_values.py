"""Values of a baked layer in Dr.Jit: light scattered once, boundary and base exactly, the rest from the grid of its table.

What `bakery.kernels.surface_reflectance` and `surface_transmittance` do in loops of numba.
"""

import math
from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from renderers.mitsuba import layers
from renderers.mitsuba.rows import at, bands, between, held, pick

LEAST = 1e-6  # cosine; single precision has no smaller ones to add to


class Pair(NamedTuple):
    """Two directions, as a layer sees them.

    mu, mu0 : cosines in air, positive;  inner, inner0 : in the medium;  sines : product of the sines in the medium times the
    cosine of the azimuth between the directions of travel;  cos_phi : that;  reflects : whether both are on one side
    """

    mu: object
    mu0: object
    inner: object
    inner0: object
    sines: object
    cos_phi: object
    reflects: object


class Values:
    """Reflectance and transmittance of a layer, in the variant that is set.

    layer : `layers.Layer`;  channel, wavelength : of the plugin's parameters
    """

    def __init__(self, layer, channel, wavelength):
        self.layer, self._channels = layers.selected(layer, channel, wavelength, bands())
        table = self.layer.table
        self.index, self.rough, self.roughness, self.free = table.index, self.layer.rough, table.roughness, table.free
        self._finite, self._based = bool(np.isfinite(table.depth).any()), bool(np.any(table.base > 0))
        self._jit = dr.is_jit_v(mi.Float)
        self._nodes, self._azimuths = table.reflected.shape[1], table.reflected.shape[3]
        self._size = table.reflected[0].size  # of a row
        self._grid = held(np.concatenate([table.reflected.ravel(), table.transmitted.ravel()]))
        self._behind = table.reflected.size  # where transmitted light begins
        steps = 1 << math.ceil(math.log2(len(table.s)))
        self._halves, self._angles = steps // 2, len(table.s)
        self._s = held(np.concatenate([table.s, np.full(steps - len(table.s) + 1, 2.0)]))
        self._phase = held(table.phase)
        self._depth, self._once, self._peak, self._base = (
            held(values) for values in (table.depth, table.once, table.peak, table.base))
        self._index_below, self._told = table.index_below, table.mirrored.shape[1]  # how often unscattered light is told
        self._rooted, self._crowded = table.rooted, table.crowded
        self._single = held(np.concatenate([table.mirrored, np.maximum(table.straight, 0.0)]))

    # ---- directions

    def pair(self, wi, wo):
        mu0, mu = dr.clip(dr.abs(wi.z), LEAST, 1.0), dr.clip(dr.abs(wo.z), LEAST, 1.0)
        across = -(wi.x * wo.x + wi.y * wo.y)
        sines = dr.sqrt((wi.x * wi.x + wi.y * wi.y) * (wo.x * wo.x + wo.y * wo.y))
        cos_phi = pick(sines > 1e-12, dr.clip(across / dr.maximum(sines, 1e-12), -1.0, 1.0), 0.0)
        reflects = wi.z * wo.z > 0
        inner = self._inside(mu, self.index)
        if self._index_below != self.index:
            inner = pick(reflects, inner, self._inside(mu, self._index_below))
        return Pair(mu, mu0, inner, self._inside(mu0, self.index), across / self.index**2, cos_phi, reflects)

    def _inside(self, mu, index):
        if index == 1.0 or self.rough:
            return mu
        return dr.sqrt(dr.maximum((index - 1) * (index + 1) + mu * mu, 0.0)) / index

    def fresnel(self, mu, inner, n):
        """Share that a boundary of an index reflects; cosines outside and inside."""
        if n == 1.0:
            return mu * 0.0
        across, along = (mu - n * inner) / (mu + n * inner), (n * mu - inner) / (n * mu + inner)
        return pick(inner > 0, 0.5 * (across * across + along * along), 1.0)

    # ---- values

    def rows(self, si):
        """[(row, weight), ...] of each channel; rows are numbers or UInt32 arrays."""
        if self._channels:
            return self._channels
        knots = self.layer.wavelength
        if len(knots) == 1:
            return [[(0, 1.0)]]
        places = (between(knots, si.wavelengths[k]) for k in range(len(si.wavelengths)))
        return [[(lower, 1 - weight), (lower + 1, weight)] for lower, weight in places]

    def _through(self, pair):
        """Shares that enter and leave, over both indices."""
        enters, leaves = 1 - self.fresnel(pair.mu0, pair.inner0, self.index), 1 - self.fresnel(pair.mu, pair.inner, self.index)
        back = leaves * enters / self.index**2
        below = self._index_below
        if below == self.index:
            return back
        return pick(pair.reflects, back, (1 - self.fresnel(pair.mu, pair.inner, below)) * enters / (self.index * below))

    def _coordinate(self, mu, inner):
        s = dr.sqrt(dr.minimum(mu, inner)) if self._rooted else mu
        x = (crowded(s) if self._crowded else 1 - dr.sqrt(dr.maximum(1 - s, 0.0))) * (self._nodes - 1)
        node = dr.minimum(mi.UInt32(x), self._nodes - 2)
        return node, x - node

    def values(self, channels, pair, active):
        """pi times BRDF or BTDF of each channel, without light that goes on in single directions; facets included."""
        (i, x), (j, y) = self._coordinate(pair.mu, pair.inner), self._coordinate(pair.mu0, pair.inner0)
        z = azimuth_coordinate(pair.cos_phi)
        z = (crowded(z) if self._crowded else z) * (self._azimuths - 1)
        k = dr.minimum(mi.UInt32(z), self._azimuths - 2)
        z = z - k
        cell = (i * self._nodes + j) * self._azimuths + k
        if self.free:
            cell = cell + pick(pair.reflects, mi.UInt32(0), mi.UInt32(self._behind))
        corners = [(cell + (a * self._nodes + b) * self._azimuths, (x if a else 1 - x) * (y if b else 1 - y))
                   for a in range(2) for b in range(2)]

        def smooth(row):
            total = 0.0
            for corner, weight in corners:
                below, above = (at(self._grid, corner + row * self._size + step, active) for step in (0, 1))
                total = total + weight * dr.fma(above - below, z, below)
            return total

        if self.rough:
            facets = self._of_facets(pair)
            values = {}
            return [self._summed(channel, values, lambda row: smooth(row) + facets) for channel in channels]
        through = self._through(pair)
        step, t = self._angle(pair, active)
        values = {}

        def layer(row):
            phase = at(self._phase, step + row * self._angles, active)
            phase = dr.fma(at(self._phase, step + row * self._angles + 1, active) - phase, t, phase)
            once = at(self._once, row + mi.UInt32(0), active) * phase
            return pick(through > 0, through * self._sent(row, pair, smooth(row), once, active), 0.0)

        return [self._summed(channel, values, layer) for channel in channels]

    def _summed(self, channel, values, function):
        """Of a channel; rows that are numbers are computed once."""
        total = None
        for row, weight in channel:
            if isinstance(row, int) and row in values:
                value = values[row]
            else:
                value = function(row)
                if isinstance(row, int):
                    values[row] = value
            total = value * weight if total is None else total + value * weight
        return total

    def _sent(self, row, pair, smooth, once, active):
        """Reflectance or transmittance inside of the boundary, from what is smooth and what is scattered once."""
        total = pair.inner + pair.inner0
        if not self._finite:
            return pick(pair.reflects, (smooth + once) / total, smooth) if self.free else (smooth + once) / total
        depth = at(self._depth, row + mi.UInt32(0), active)
        x, x0 = 1 / dr.maximum(pair.inner, LEAST), 1 / dr.maximum(pair.inner0, LEAST)
        stopped, stopped0 = _stopped(depth * x), _stopped(depth * x0)
        on_both = stopped + stopped0 - stopped * stopped0
        result = (smooth * stopped * stopped0 + once * on_both) / total
        if self._based:
            result = result + at(self._base, row + mi.UInt32(0), active) * (1 - on_both)
        if not self.free:
            return result
        rate = depth * dr.abs(x - x0)
        mean = pick(rate > 1e-6, _stopped(rate) / dr.maximum(rate, 1e-6), 1.0)
        direct = x * x0 * depth * (1 - dr.minimum(stopped, stopped0)) * mean
        return pick(pair.reflects, result, smooth * stopped * stopped0 + once * direct)

    def _angle(self, pair, active):
        """Interval of the scattering angle, and its share of it: s = sin^2(theta / 2) by differences of the directions."""
        sides = pair.inner + pair.inner0
        if self.free:
            sides = pick(pair.reflects, sides, pair.inner - pair.inner0)
        squares = (2 - pair.mu * pair.mu - pair.mu0 * pair.mu0) / self.index**2 - 2 * pair.sines
        s = dr.clip(0.25 * (sides * sides + squares), 0.0, 1.0)
        step, half = mi.UInt32(0), self._halves
        while half:
            step = step + pick(at(self._s, step + half, active) <= s, mi.UInt32(half), mi.UInt32(0))
            half //= 2
        step = dr.minimum(step, self._angles - 2)
        below = at(self._s, step, active)
        return step, dr.clip((s - below) / (at(self._s, step + 1, active) - below), 0.0, 1.0)

    def _of_facets(self, pair):
        """R of light that facets reflect once (GGX, Smith's shadowing)."""
        doubled = pair.mu * pair.mu0 - pair.sines * self.index**2
        onto = dr.sqrt(dr.maximum(0.5 * (1 + doubled), 1e-12))
        upright = dr.minimum(0.5 * (pair.mu + pair.mu0) / onto, 1.0)
        square = self.roughness**2
        spread = (square - 1) * upright * upright + 1
        seen = 4 / ((1 + dr.sqrt(1 + square * (1 / (pair.mu * pair.mu) - 1)))
                    * (1 + dr.sqrt(1 + square * (1 / (pair.mu0 * pair.mu0) - 1))))
        inner = dr.sqrt(dr.maximum((self.index - 1) * (self.index + 1) + onto * onto, 0.0)) / self.index
        return seen * self.fresnel(onto, inner, self.index) * square / (spread * spread) / (4 * pair.mu * pair.mu0)

    def single(self, channels, mu, active):
        """Mirrored and unscattered light of each channel, which go on in single directions."""
        inner = self._inside(mu, self.index)
        front = self.fresnel(mu, inner, self.index) if self.layer.mirrors else mu * 0.0
        if self._told:
            return self._single_of_layers(channels, mu, front, active)
        if not self.free:
            return [front for _ in channels], [mu * 0.0 for _ in channels]
        values = {}

        def of_row(row):
            x = 1 / dr.maximum(inner, LEAST)
            passes = dr.exp(-at(self._depth, row + mi.UInt32(0), active) * x)
            down = (1 - front) ** 2 * passes / dr.maximum(1 - (front * passes) ** 2, 1e-9)
            # light of the peak is counted as scattered
            unscattered = dr.maximum(1 - at(self._peak, row + mi.UInt32(0), active) * x, 0.0)
            return mi.Vector2f(pick(inner > 0, down * front * passes, 0.0), pick(inner > 0, down * unscattered, 0.0))

        sums = [self._summed(channel, values, of_row) for channel in channels]
        return [front + part.x for part in sums], [part.y for part in sums]


    def _single_of_layers(self, channels, mu, front, active):
        """`single` of layers on each other, linear between the cosines at which it is told."""
        x = (1 - dr.sqrt(dr.maximum(1 - dr.sqrt(mu), 0.0))) * (self._told - 1)
        node = dr.minimum(mi.UInt32(x), self._told - 2)
        x = x - node

        def of_row(row):
            start = row * self._told + node
            return dr.lerp(*(at(self._single, start + step, active) for step in (0, 1)), x)

        rows = len(self.layer.table.mirrored)
        mirrored, straight = {}, {}
        return ([front + self._summed(channel, mirrored, of_row) for channel in channels],
                [self._summed(channel, straight, lambda row: of_row(row + rows)) for channel in channels])


def azimuth_coordinate(cos_phi):
    """Coordinate of an azimuth, `layers.azimuth`'s inverse."""
    return crowded(0.5 - 0.5 * cos_phi)


def crowded(z):
    """As `look_up._crowded`, of what rounding may have taken beyond 0 or 1."""
    return 0.5 * (1 + dr.sqrt(dr.maximum(z, 0.0)) - dr.sqrt(dr.maximum(1 - z, 0.0)))


def _stopped(x):
    """1 - exp(-x), to single precision where x is small, too."""
    return pick(x < 0.01, x * (1 - x * (0.5 - x * (1 / 6))), 1 - dr.exp(-x))
