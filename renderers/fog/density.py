"""Where the medium is and how dense: relative density in space and its moments along rays.

The moments are all that a filter needs of a density (docs/screen.md): S_n = integral of rho(z') (z - z')^n dz' from the camera to
the distance z.  S_0 is the column, sqrt(3 S_2/S_0) the lever: the distance at which a homogeneous medium would spread light as
far.
"""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import map_coordinates
from scipy.special import hyp1f1

from renderers.fog import _march
from renderers.threads import run


class Density(ABC):
    """Density relative to that of the asset's medium, 0 or more; positions in m."""

    @abstractmethod
    def at(self, points) -> np.ndarray:
        """Relative density at points (..., 3) m, (...)."""

    @abstractmethod
    def integrals(self, origin, direction, distance) -> np.ndarray:
        """Moments of the density about the ends of rays.

        Parameters
        ----------
        origin : (N, 3) m, or (3,) for all
        direction : (N, 3), unit
        distance : (N,) m, 0 or more, or inf

        Returns
        -------
        moments : (N, 3), S_0, S_1, S_2 in m, m^2, m^3.  Along a ray without end S_1 and S_2 are inf (0 in empty space), and S_0
            is so where the density goes on for ever

        Notes
        -----
        Closed forms for uniform and height, exact quadrature of the interpolant for grids: 1e-12 of the moment.
        """

    def reach(self, origin) -> float:
        """Distance from `origin` (3,) beyond which there is nothing, m; inf where the density goes on for ever."""
        return math.inf if self.scale else 0.0


@dataclass(frozen=True)
class Uniform(Density):
    """The same everywhere."""

    scale: float = 1.0

    def at(self, points):
        return np.full(np.shape(points)[:-1], float(self.scale))

    def integrals(self, origin, direction, distance):
        z = np.asarray(distance, float)
        return self.scale * np.stack([z, z**2 / 2, z**3 / 3], axis=-1) if self.scale else np.zeros((*z.shape, 3))


@dataclass(frozen=True)
class Height(Density):
    """`scale` up to the height `base`, and falling by e each `falloff` above; heights in m along `up`."""

    scale: float
    base: float
    falloff: float
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)

    def __post_init__(self):
        length = math.hypot(*self.up)
        if not (length > 0 and self.falloff > 0):
            raise ValueError(f"up {self.up} and falloff {self.falloff:g}; a direction and a falloff above 0 would do")
        object.__setattr__(self, "up", tuple(component / length for component in self.up))

    def _height(self, points):
        x, y, z = np.moveaxis(np.asarray(points, float), -1, 0)
        return x * self.up[0] + y * self.up[1] + z * self.up[2]

    def at(self, points):
        return self.scale * np.exp(-np.maximum(self._height(points) - self.base, 0.0) / self.falloff)

    def integrals(self, origin, direction, distance):
        slope = self._height(direction)
        z = np.broadcast_to(np.asarray(distance, float), slope.shape)
        if not self.scale:
            return np.zeros((*z.shape, 3))
        start = np.broadcast_to(self._height(origin) - self.base, z.shape)
        with np.errstate(divide="ignore", invalid="ignore"):
            meeting = -start / slope  # where the ray passes the height `base`
        parted = (meeting > 0) & (meeting < z)
        near = np.where(parted, meeting, z)
        far = z - np.where(parted, meeting, 0.0)
        first = self._piece(start, slope, near)
        second = self._piece(np.zeros_like(start), slope, far)
        return self.scale * np.where(parted[..., None], _joined(first, second, far), first)

    def _piece(self, start, slope, length):
        """Moments, about its end, of a part of a ray that lies on one side of `base`; heights above that."""
        climb = slope * np.where(slope == 0, 0.0, length)
        above = start + climb / 2 > 0
        rate = np.where(above, slope / self.falloff, 0.0)
        # the density at the lower end, so that neither a steep climb nor a steep fall overflows
        lower = np.where(above, np.maximum(np.minimum(start, start + climb), 0.0), 0.0)
        rising, sinking = _falling(np.maximum(rate, 0.0), length), _growing(np.maximum(-rate, 0.0), length)
        return np.exp(-lower / self.falloff)[..., None] * np.where((rate >= 0)[..., None], rising, sinking)


@dataclass(frozen=True, eq=False)
class Grid(Density):
    """Trilinear between the centres of cells that fill the box from `lo` to `hi` (m); within half a cell of its faces as at the
    nearest centres, and 0 outside.

    `values` (X, Y, Z), 0 or more; so `gridvolume` of Mitsuba reads the same numbers with its filter trilinear and its wrap clamp.
    """

    values: np.ndarray
    lo: tuple[float, float, float]
    hi: tuple[float, float, float]
    scale: float = 1.0

    def __post_init__(self):
        if np.ndim(self.values) != 3 or not np.size(self.values):
            raise ValueError(f"values of shape {np.shape(self.values)}: three axes with an entry or more each would do")
        if not all(low < high for low, high in zip(self.lo, self.hi)):
            raise ValueError(f"lo {self.lo} and hi {self.hi}: hi is above lo along each axis")
        values = self.values if self.values.dtype in (np.float32, np.float64) else self.values.astype(np.float32)
        object.__setattr__(self, "values", np.ascontiguousarray(values))

    def _cells(self):
        """Origin and cells per m of the coordinates in which the nodes are the whole numbers."""
        lo, hi = np.array(self.lo, float), np.array(self.hi, float)
        return lo, np.array(self.values.shape) / (hi - lo)

    def at(self, points):
        lo, per_metre = self._cells()
        cells = (np.asarray(points, float) - lo) * per_metre - 0.5
        inside = ((cells >= -0.5) & (cells <= np.array(self.values.shape) - 0.5)).all(axis=-1)
        values = map_coordinates(self.values, cells.reshape(-1, 3).T, output=float, order=1, mode="nearest")
        return self.scale * np.where(inside, values.reshape(inside.shape), 0.0)

    def integrals(self, origin, direction, distance):
        direction = np.ascontiguousarray(direction, float)
        distance = np.array(np.broadcast_to(np.asarray(distance, float), direction.shape[:-1]), order="C")
        lo, per_metre = self._cells()
        start = np.array(np.broadcast_to((np.asarray(origin, float) - lo) * per_metre - 0.5, direction.shape), order="C")
        step = direction * per_metre
        out = np.empty(direction.shape)

        def block(low, high):
            _march.moments(self.values, *(rays[low:high] for rays in (start, step, distance, out)))

        run(block, len(direction))
        return self.scale * out if self.scale else np.zeros_like(out)

    def reach(self, origin):
        if not self.scale or not self.values.any():
            return 0.0
        away = np.maximum(np.abs(np.array(self.lo) - origin), np.abs(np.array(self.hi) - origin))
        return float(math.hypot(*away))


# ---- pieces of rays


def _joined(near, far, length):
    """Moments about the end of a ray from those of its two parts, each about its own end; the far one has this `length`."""
    s0, s1, s2 = np.moveaxis(near, -1, 0)
    with np.errstate(invalid="ignore"):  # 0 times inf: nothing is in front of what has no end
        carried = np.stack([s0, s1 + s0 * length, s2 + length * (2 * s1 + s0 * length)], axis=-1)
    return np.where(near[..., :1] > 0, carried, 0.0) + far


def _falling(rate, length):
    """Integrals of e^{-rate t} (length - t)^n for t from 0 to `length`, (..., 3), n = 0, 1, 2; rate 0 or more."""
    endless = np.isinf(length) & (rate > 0)
    x, ends = rate * np.where(endless | (rate == 0), 0.0, length), (1 / np.where(rate > 0, rate, 1.0), math.inf, math.inf)
    # Kummer's function holds 1e-15 on both sides of x = 1
    return np.stack([np.where(endless, end, length ** (n + 1) / (n + 1) * hyp1f1(1, n + 2, -x)) for n, end in enumerate(ends)],
                    axis=-1)


def _growing(rate, length):
    """Integrals of e^{-rate t} t^n for t from 0 to `length`, (..., 3), n = 0, 1, 2; 0 where `length` is inf or rate 0."""
    length = np.where(np.isfinite(length) & (rate > 0), length, 0.0)
    return np.stack([length ** (n + 1) / (n + 1) * hyp1f1(n + 1, n + 2, -rate * length) for n in range(3)], axis=-1)
