"""What the functions of geometrical optics take: ranges, and what is said of values beyond them."""

import operator

import numpy as np

from bakery.physics.mie import X_MAX, checked

X_LOW, X_HIGH = 1.0, 1e8
EDGES = (None, "narrow", "wide")
ORDERS_MAX = 50


def large(m, x):
    """As `bakery.mie._checked`, for x from 1 to 1e8."""
    try:
        x = np.asarray(x, dtype=np.float64)
    except (TypeError, ValueError):
        raise ValueError(f"x is a number or an array of numbers, found {x!r}") from None
    bad = ~((x >= X_LOW) & (x <= X_HIGH))
    if bad.any():
        raise ValueError(f"x = {x[bad].flat[0]:g}: rays are for size parameters from {X_LOW:g} (sensibly 30) to {X_HIGH:g}; "
                         "take bakery.mie below")
    shape, m, _ = checked(m, np.minimum(x, X_MAX))
    return shape, np.array(m), np.array(np.broadcast_to(x, shape).reshape(-1))


def options(orders, edge):
    try:
        orders = operator.index(orders)
    except TypeError:
        raise ValueError(f"orders = {orders!r}: a whole number of chords, 0 to {ORDERS_MAX}") from None
    if not 0 <= orders <= ORDERS_MAX:
        raise ValueError(f"orders = {orders}: 0 to {ORDERS_MAX} chords are followed")
    if not (edge is None or isinstance(edge, str)) or edge not in EDGES:
        raise ValueError(f"edge = {edge!r}: 'narrow', 'wide' or None (no exact partial waves)")
    return orders, edge
