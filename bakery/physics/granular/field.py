"""Numbers that vary in space: values at the middles of the cells of a box, trilinear in between, constant in the outer halves."""

from typing import NamedTuple

import numpy as np

from bakery.physics.packing.instances import rotation, uniforms
from bakery.system.compiled import njit


class Field(NamedTuple):
    """K numbers at every point; beyond the box those of its nearest point.

    low, edge (3,) : corner of the box, edges of a cell
    values (X, Y, Z, K) float32 : empty where nothing varies
    """

    low: np.ndarray
    edge: np.ndarray
    values: np.ndarray


def field(low, high, values) -> Field:
    """Of values (X, Y, Z) or (X, Y, Z, K) in a box between low (3,) and high (3,)."""
    values = np.asarray(values)
    shape = values.shape[:3]
    values = np.require(values.reshape(*shape, -1), np.float32, "CW")  # one kind of array: kernels are compiled once
    low = np.array(low, float)
    return Field(low, (np.array(high, float) - low) / shape, values)


def uniform_field() -> Field:
    """Of what does not vary."""
    return Field(np.zeros(3), np.ones(3), np.zeros((0, 0, 0, 0), np.float32))


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def between(field, x, y, z):
    """The cells around a point, and the way from one to the other: i, j, k and u, v, w, 0 to 1."""
    low, edge, values = field.low, field.edge, field.values
    u = min(max((x - low[0]) / edge[0] - 0.5, 0.0), values.shape[0] - 1.0)
    v = min(max((y - low[1]) / edge[1] - 0.5, 0.0), values.shape[1] - 1.0)
    w = min(max((z - low[2]) / edge[2] - 0.5, 0.0), values.shape[2] - 1.0)
    i, j, k = int(u), int(v), int(w)
    return i, j, k, u - i, v - j, w - k


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def value(field, where, n):
    """Number n of a field at a place from `between`; exact where all around are the same."""
    values = field.values
    i, j, k, u, v, w = where
    p, q, r = min(i + 1, values.shape[0] - 1), min(j + 1, values.shape[1] - 1), min(k + 1, values.shape[2] - 1)
    a = values[i, j, k, n] + w * (values[i, j, r, n] - values[i, j, k, n])
    b = values[i, q, k, n] + w * (values[i, q, r, n] - values[i, q, k, n])
    c = values[p, j, k, n] + w * (values[p, j, r, n] - values[p, j, k, n])
    d = values[p, q, k, n] + w * (values[p, q, r, n] - values[p, q, k, n])
    a += v * (b - a)
    c += v * (d - c)
    return a + u * (c - a)


@njit(cache=True, nogil=True, error_model="numpy")
def first_above(field, where, u):
    """The first of the numbers at a place that lies above u; the last one if none does before it."""
    last = field.values.shape[3] - 1
    for n in range(last):
        if u < value(field, where, n):
            return n
    return last


@njit(cache=True, nogil=True, error_model="numpy")
def instance_of(seed, i, j, k, sphere, mixture, x, y, z):
    """As `instance`, with the cumulated shares of a `Field` at the sphere's centre; compiled."""
    a, b, c, d = uniforms(seed, i, j, k, sphere)
    return first_above(mixture, between(mixture, x, y, z), a), rotation(b, c, d)


def largest(field, low, edge, shape):
    """(X, Y, Z) upper bounds of a field's first number in boxes of a lattice: corner low (3,), edges (3,), shape (3,)."""
    bounds_of = field.values[..., 0]
    for axis in range(3):
        bounds = (low[axis] + np.arange(shape[axis] + 1) * edge[axis] - field.low[axis]) / field.edge[axis] - 0.5
        first = np.clip(np.floor(bounds[:-1]), 0, bounds_of.shape[axis] - 1).astype(int)
        last = np.clip(np.ceil(bounds[1:]), 0, bounds_of.shape[axis] - 1).astype(int)
        bounds_of = np.stack([bounds_of.take(range(a, b + 1), axis).max(axis) for a, b in zip(first, last)], axis)
    return bounds_of


def sampled(field, x, y, z):
    """A field's first number (X, Y, Z) on a lattice of coordinates x (X,), y (Y,), z (Z,)."""
    values = field.values[..., 0].astype(float)
    for axis, at in enumerate((x, y, z)):
        count = values.shape[axis]
        u = np.clip((at - field.low[axis]) / field.edge[axis] - 0.5, 0, count - 1)
        first = u.astype(int)
        weight = (u - first).reshape([-1 if k == axis else 1 for k in range(3)])
        low, high = values.take(first, axis), values.take(np.minimum(first + 1, count - 1), axis)
        values = low + weight * (high - low)
    return values
