"""Event-driven hard spheres that grow: what happens to them, one event after the other.

Lubachevsky & Stillinger 1990; Skoge, Donev, Stillinger & Torquato 2006 (collision rule).  Each sphere has exactly one pending
event: a contact, leaving its bubble (`_lists`), or a check (its partner went elsewhere).

Masses are 1.  Positions are kept for clock zero: a pair's distance at t takes no stored time of its own, and `advance` sets the
clock back before that costs digits.
"""

import numpy as np

from bakery.physics.packing._approach import first_touch
from bakery.physics.packing._lists import CODES, DUE, FIRST, INNER, LAST, STRICT, R, V, X, relist
from bakery.physics.packing._queue import USED, next_event, push
from bakery.system.compiled import njit

LEAVE, CHECK, NONE = -1, -2, -3  # in place of a partner
DEEP = 4096  # spheres beyond which memory is asked for ahead: with fewer all stays in the cache
STOPPED, PAUSED, WINDOW, FULL = 0, 1, 2, 3  # why `run` came back
TIME, SCALE, RATE, VIRIAL, NEAREST, FARTHEST = range(6)  # of `clock`
COLLISIONS, LEAVES, CHECKS = range(3)  # of `tally`


@njit(**INNER)
def _leaving(st, i, x, y, z, scale):
    """Time until sphere i, now at (x, y, z), leaves its bubble: |q + v tau| = w - g tau, the first root after now."""
    vx, vy, vz, radius = st.sphere[i, V], st.sphere[i, V + 1], st.sphere[i, V + 2], st.sphere[i, R]
    qx, qy, qz = x - st.bubble[i, 0], y - st.bubble[i, 1], z - st.bubble[i, 2]
    w, g = st.bubble[i, 3] - radius * scale, radius * st.clock[RATE]
    a = vx * vx + vy * vy + vz * vz - g * g
    b = qx * vx + qy * vy + qz * vz + w * g
    c = qx * qx + qy * qy + qz * qz - w * w
    root = np.sqrt(max(b * b - a * c, 0.0))
    if b > 0.0:
        return max(-c / (b + root), 0.0)
    if a > 0.0:
        return max((root - b) / a, 0.0)
    return np.inf  # at rest and not growing


@njit(**INNER)
def _let_go(st, i):
    """Sphere i goes elsewhere: who had agreed to meet it has to look again when they would have met."""
    if st.partner[i] >= 0:
        st.partner[st.partner[i] >> 5] = CHECK
        push(st, st.partner[i] >> 5, st.sphere[i, DUE])


@njit(**INNER)
def _agree(st, i, choice, due):
    """Enter the next event of sphere i, for its partner too."""
    _let_go(st, i)
    first = i
    if choice >= 0:
        j = choice >> 5
        first = min(i, j)
        _let_go(st, j)
        st.partner[j] = 32 * i + CODES - 1 - (choice & 31)
        st.sphere[j, DUE] = due
    st.partner[i] = choice
    st.sphere[i, DUE] = due
    push(st, first, due)


@njit(**INNER)
def predict(st, i, t):
    """Find i's next event after t and enter it, for its partner too; one that a partner has already agreed on is a candidate."""
    scale, rate = st.clock[SCALE] + st.clock[RATE] * t, st.clock[RATE]
    vx, vy, vz, radius = st.sphere[i, V], st.sphere[i, V + 1], st.sphere[i, V + 2], st.sphere[i, R]
    x, y, z = st.sphere[i, X] + vx * t, st.sphere[i, X + 1] + vy * t, st.sphere[i, X + 2] + vz * t

    soon = _leaving(st, i, x, y, z, scale)
    choice = LEAVE
    agreed = st.partner[i]
    if agreed >= 0 and st.sphere[i, DUE] - t <= soon:
        soon = st.sphere[i, DUE] - t
        choice = agreed

    tau, near = first_touch(st.sphere, st.near, st.index[i, FIRST], st.index[i, LAST], st.shift, (x, y, z, vx, vy, vz, radius),
                            (scale, rate, t))
    if tau < soon:
        soon = tau
        choice = np.int64(near)

    if choice == agreed and agreed >= 0:
        return
    _agree(st, i, choice, t + soon)


@njit(**INNER)
def collide(st, i, j, code, t):
    """Elastic collision in the frame of the growing surfaces: the normal velocity u_n becomes 2 G - u_n."""
    si, sj = st.sphere[i], st.sphere[j]
    dx = (si[0] + si[3] * t - st.shift[code, 0]) - (sj[0] + sj[3] * t)
    dy = (si[1] + si[4] * t - st.shift[code, 1]) - (sj[1] + sj[4] * t)
    dz = (si[2] + si[5] * t - st.shift[code, 2]) - (sj[2] + sj[5] * t)
    d = np.sqrt(dx * dx + dy * dy + dz * dz)
    nx, ny, nz = dx / d, dy / d, dz / d
    radii = si[6] + sj[6]
    s, g = radii * (st.clock[SCALE] + st.clock[RATE] * t), radii * st.clock[RATE]
    kick = g - ((si[3] - sj[3]) * nx + (si[4] - sj[4]) * ny + (si[5] - sj[5]) * nz)
    kick = max(kick, 1e-12)  # never 0: the pair must part even where rounding says that it stands still
    si[3] += kick * nx
    si[4] += kick * ny
    si[5] += kick * nz
    sj[3] -= kick * nx
    sj[4] -= kick * ny
    sj[5] -= kick * nz
    si[0] -= kick * nx * t
    si[1] -= kick * ny * t
    si[2] -= kick * nz * t
    sj[0] += kick * nx * t
    sj[1] += kick * ny * t
    sj[2] += kick * nz * t
    st.clock[VIRIAL] += kick * s
    off = d / s - 1.0
    st.clock[NEAREST] = min(st.clock[NEAREST], off)
    st.clock[FARTHEST] = max(st.clock[FARTHEST], off)


@njit(**STRICT)
def predict_all(st):
    """Forget all events and find them anew at clock zero."""
    count = st.sphere.shape[0]
    st.page[USED] = st.entry.shape[0]  # the next to ask for an event begins a year
    for i in range(count):
        st.sphere[i, DUE] = np.inf
        st.partner[i] = NONE
    for i in range(count):
        predict(st, i, 0.0)


@njit(**STRICT)
def advance(st):
    """Bring all spheres to the clock's time and set it to zero; returns twice the kinetic energy, at zero total momentum."""
    t = st.clock[TIME]
    count = st.sphere.shape[0]
    twice = 0.0
    for k in range(3):
        drift = 0.0
        for i in range(count):
            st.sphere[i, X + k] += st.sphere[i, V + k] * t
            drift += st.sphere[i, V + k]
        drift /= count
        for i in range(count):
            st.sphere[i, V + k] -= drift
            twice += st.sphere[i, V + k] ** 2
    st.clock[SCALE] += st.clock[RATE] * t
    st.clock[TIME] = 0.0
    return twice


@njit(**STRICT)
def run(st, stop, collisions, events):
    """Handle events up to a time, a number of collisions in all, or a number of events, and say which it was."""
    handled = 0
    deep = st.sphere.shape[0] > DEEP
    while True:
        i = next_event(st, st.clock[TIME], deep)
        t = st.sphere[i, DUE] if i >= 0 else np.inf
        if t >= stop:
            st.clock[TIME] = stop
            return STOPPED
        if st.tally[COLLISIONS] >= collisions:
            st.clock[TIME] += 0.5 * (t - st.clock[TIME])  # between two events, where no pair is in touch
            return WINDOW
        if handled >= events:
            return PAUSED
        handled += 1
        st.clock[TIME] = t
        partner = st.partner[i]
        partner_left = -1
        if partner >= 0:
            partner_left = partner >> 5
            collide(st, i, partner_left, partner & 31, t)
            st.tally[COLLISIONS] += 1
            st.partner[i] = NONE
            st.partner[partner_left] = NONE
            st.sphere[i, DUE] = np.inf
            st.sphere[partner_left, DUE] = np.inf
        elif partner == LEAVE:
            st.tally[LEAVES] += 1
            if not relist(st, i, t):
                return FULL
        else:
            st.tally[CHECKS] += 1
        while i >= 0:  # one call of `predict` in the code, for it is compiled in place
            predict(st, i, t)
            i, partner_left = partner_left, -1
