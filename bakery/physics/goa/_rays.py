"""Which rays of a sphere leave at which angle: geometry, independent of its size.

Time factor exp(+i w t) with eta = n - ik, van de Hulst's signs.  A ray that meets the surface at incidence t (refracted: tt) and
leaves after p chords has turned by the unfolded angle

    theta_p(t) = 2 p tt - 2 t - (p - 1) pi,      d theta_p/dt = 2 (p cos t/w - 1),      w = sqrt(n^2 - sin^2 t),

and is seen at theta = q (theta_p - 2 pi l), q = +-1.  Here its target is written T = M pi + beta or M pi - beta, beta the angle
from the nearer end of the axis (M even: forward): the two signs are the two halves of a ring around the axis.  For 1 < n < p
theta_p has a maximum, the rainbow, at cos^2 t = (n^2 - 1)/(p^2 - 1); below it two rays share a target, above it there is a
pair of complex rays.

Angles ascend: then the rays of one segment, pole and sign belong to a stretch of neighbouring angles, and so do those that pair.
"""

from typing import NamedTuple

import numpy as np

from bakery.physics.goa._solve import ROWS, T_I, WIDTH, B, T, complex_rays, real_rays
from bakery.physics.goa._special import STRICT, sincos
from bakery.physics.goa._surface import COLUMNS, EXISTS, OF_REAL, OUT_ROWS, PATH, PATH_I, SINE, beyond, outside, real
from bakery.system.compiled import njit

# An item: kind, first angle, number of angles, row of the first ray and of its partner (-1: none); phase; sign of d theta_p/dt
# (rainbow: +1 for the ray of smaller t); +1 forward, -1 backward
KIND, ANGLE, COUNT, ROW, PARTNER, KAPPA, SIGN, END = range(8)
SINGLE, RAINBOW, AXIS, DARK, FOCUS = range(5)  # FOCUS: single, the ray along the axis
FADED = 120.0  # exponent of the dark side, as estimated, from which nothing is left
DARKEST = 40.0  # e^-40 of the bright side is nothing
REACH = 0.7  # rad that a complex ray is followed into the dark side
APART = 1e-9  # rad: nearer to the rainbow angle the two rays differ by rounding
NEAREST = 1e-10  # rad from the axis


class Order(NamedTuple):
    """Rays of an order p: index, turning at the rim (incidence `rim`), rainbow (incidence, or -1 where there is none; turning, or
    the largest), how far into its dark side (rad), least distance in turning, linear part of the guess inside and outside."""

    eta: complex
    p: int
    rim: float
    last: float
    bow: float
    top: float
    reach: float
    most: float
    curve: tuple


class Lanes(NamedTuple):
    """Angles from the nearer end of the axis (A,) and their sines; memory of `_solve` and of `_surface`."""

    beta: np.ndarray
    sine: np.ndarray
    w: np.ndarray
    o: np.ndarray


class Target(NamedTuple):
    """The angles first..last with the turning turns pi + sign beta."""

    first: int
    last: int
    turns: int
    sign: float


class Segment(NamedTuple):
    """Incidence and turning at the anchor and at the far end; whether the anchor is a rainbow, whether the axial ray is among the
    rays, share of the linear part of the guess."""

    near: float
    near_turning: float
    far: float
    far_turning: float
    bow: bool
    focus: bool
    curve: float


class Pole(NamedTuple):
    """Rays around one end of the axis: first and last angle and row of each part and side (2, 2, 3), phases of the sides, signs
    of the parts, kind of single rays, the end (1 forward, -1 backward), whether pairs across rainbow and axis are made."""

    spans: np.ndarray
    kappas: np.ndarray
    signs: np.ndarray
    kind: int
    end: float
    rainbow: bool
    axis: bool


@njit(**STRICT)
def turning(n, p, t):
    """theta_p(t) + (p - 1) pi."""
    return 2.0 * p * np.arcsin(min(np.sin(t) / n, 1.0)) - 2.0 * t


@njit(**STRICT)
def _stretch(beta, first, last, middle, sign, low, high):
    """Indices first..last of the angles, beta monotone there, whose target middle + sign beta lies in low..high."""
    if first >= last or low > high:
        return first, first
    rising = (sign * beta[last - 1] >= sign * beta[first]) if last - first > 1 else True
    ends = np.empty(2, np.int64)
    for side in range(2):
        a, b = first, last
        while a < b:
            i = (a + b) // 2
            target = middle + sign * beta[i]
            if rising:
                before = target < low if side == 0 else target <= high
            else:
                before = target > high if side == 0 else target >= low
            if before:
                a = i + 1
            else:
                b = i
        ends[side] = a
    return ends[0], max(ends[0], ends[1])


@njit(**STRICT)
def _keep(o, count, rays, row, columns):
    for column in range(columns):
        if count == WIDTH:  # a known length: one instruction
            for j in range(WIDTH):
                rays[column, row + j] = o[column * WIDTH + j]
        else:
            for j in range(count):
                rays[column, row + j] = o[column * WIDTH + j]


@njit(**STRICT)
def _lit(order, lanes, target, segment, rays, row):
    """Rays of one segment for the angles of a target, rows from `row`."""
    eta, p, most, curve = order.eta, order.p, order.most, segment.curve
    beta, sine, w, o = lanes
    first, last, turns, sign = target
    near, near_turning, far, far_turning = segment.near, segment.near_turning, segment.far, segment.far_turning
    side = -1.0 if (far - near) * (far_turning - near_turning) > 0.0 else 1.0
    low, high = min(near, far), max(near, far)
    for start in range(first, last, WIDTH):
        count = min(WIDTH, last - start)
        for j in range(WIDTH):
            i = start + min(j, count - 1)
            w[B + j], o[SINE * WIDTH + j] = beta[i], sine[i]
        for j in range(WIDTH):
            turned = turns * np.pi + sign * w[B + j]
            turned = turned if turned < most else most
            y = (turned - near_turning) / (far_turning - near_turning)
            y = y if y > 0.0 else 0.0
            y = np.sqrt(y) if segment.bow else y
            w[B + j] = 0.5 * turned
            w[T + j] = near + (far - near) * y * (curve + (1.0 - curve) * y)
        real_rays(eta.real, p, side, low, high, w)
        real(eta, p, segment.bow, segment.focus, w, o)
        _keep(o, count, rays, row + start - first, OF_REAL)


@njit(**STRICT)
def _dark(order, lanes, target, x, rays, row):
    """Complex rays for the angles of a target, whose turning is beyond that of the rainbow.

    Rows from `row` for all angles; returns the stretch of angles whose rays exist, not all faded for the sphere x.
    """
    eta, p, bow, least = order.eta, order.p, order.bow, order.top
    beta, sine, w, o = lanes
    first, last, turns, sign = target
    n = eta.real
    s, c = np.sin(bow), np.cos(bow)
    u = np.sqrt(n * n - s * s)
    h = 2.0 * (p * p - 1.0) / (p * p) * np.tan(bow)
    skew = 2.0 * p * (n * n - 1.0) * c * (1.0 / u**3 + 3.0 * s * s / u**5) / (3.0 * h * h)
    away = sign * (beta[last - 1] - beta[first]) >= 0.0  # from the rainbow on, until nothing is left
    done = 0
    while done < last - first:
        count = min(WIDTH, last - first - done)
        for j in range(WIDTH):
            k = done + min(j, count - 1)
            i = first + k if away else last - 1 - k
            w[B + j], o[SINE * WIDTH + j] = beta[i], sine[i]
        for j in range(WIDTH):
            turned = turns * np.pi + sign * w[B + j]
            turned = turned if turned > least + APART else least + APART
            w[B + j] = 0.5 * turned
            w[T + j], w[T_I + j] = bow + skew * (turned - least), -np.sqrt(2.0 * (turned - least) / h)
        complex_rays(n, p, bow, w)
        beyond(eta, p, w, o)
        faint = 0
        for j in range(count):
            i = done + j if away else last - first - 1 - done - j
            for column in range(COLUMNS):
                rays[column, row + i] = o[column * WIDTH + j]
            faint += x * abs(o[PATH_I * WIDTH + j]) > DARKEST or o[EXISTS * WIDTH + j] == 0.0
        done += count
        if faint == count:
            break
    return (first, first + done) if away else (last - done, last)


@njit(**STRICT)
def _emit(items, used, kind, angle, count, row, partner, phase):
    """Write an item; phase : kappa, sign and end.  Returns how many are used."""
    item = items[used]
    item[KIND], item[ANGLE], item[COUNT], item[ROW], item[PARTNER] = kind, angle, count, row, partner
    item[KAPPA], item[SIGN], item[END] = phase
    return used + 1


@njit(**STRICT)
def _row(spans, part, side, angle):
    return spans[part, side, 2] + angle - spans[part, side, 0]


@njit(**STRICT)
def _pairs(present, spans, angle, rainbow, axis, rays):
    """Pairs at an angle, added up: 1, 2 across the axis (part 0, 1), 4, 8 across the rainbow (side 0, 1).

    A ray may have a partner across the rainbow and one across the axis: the smaller phase difference wins.
    """
    bows, rings = 0, 0
    for k in range(2):
        bows += (4 << k) * (rainbow and present[0, k] and present[1, k])
        rings += (1 << k) * (axis and present[k, 0] and present[k, 1])
    if bows == 0 or rings == 0:
        return bows + rings
    across, chosen = np.inf, 0
    for k in range(2):
        if bows & (4 << k):
            across = min(across, max(rays[PATH, _row(spans, 0, k, angle)] - rays[PATH, _row(spans, 1, k, angle)], 0.0))
    for k in range(2):
        if rings & (1 << k):
            around = max(rays[PATH, _row(spans, k, 0, angle)] - rays[PATH, _row(spans, k, 1, angle)], 0.0)
            chosen += (1 << k) * (around <= across)
    return chosen if chosen else bows


@njit(**STRICT)
def _gather(pole, first, last, rays, items, used):
    """Items of the rays of one pole, cut where pairs change."""
    spans, kappas, signs, end, rainbow, axis = pole.spans, pole.kappas, pole.signs, pole.end, pole.rainbow, pole.axis
    present = np.empty((2, 2), np.bool_)
    while first < last:
        stop = last
        for part in range(2):
            for side in range(2):
                present[part, side] = spans[part, side, 0] <= first < spans[part, side, 1]
                for edge in range(2):
                    if first < spans[part, side, edge] < stop:
                        stop = spans[part, side, edge]
        pairs = _pairs(present, spans, first, rainbow, axis, rays)
        if present[0, 0] and present[0, 1] and present[1, 0] + present[1, 1] > 0 \
                or present[1, 0] and present[1, 1] and present[0, 0] + present[0, 1] > 0:
            angle = first + 1
            while angle < stop and _pairs(present, spans, angle, rainbow, axis, rays) == pairs:
                angle += 1
            stop = angle
        count = stop - first
        for k in range(2):
            if pairs & (1 << k):
                used = _emit(items, used, AXIS, first, count, _row(spans, k, 0, first), _row(spans, k, 1, first),
                             (kappas[0], signs[k], end))
                present[k, 0], present[k, 1] = False, False
        for k in range(2):
            if pairs & (4 << k):
                used = _emit(items, used, RAINBOW, first, count, _row(spans, 0, k, first), _row(spans, 1, k, first),
                             (kappas[k], 1.0, end))
                present[0, k], present[1, k] = False, False
        for part in range(2):
            for side in range(2):
                if present[part, side]:
                    used = _emit(items, used, pole.kind if part == 0 else SINGLE, first, count, _row(spans, part, side, first),
                                 -1, (kappas[side], signs[part], end))
        first = stop
    return used


@njit(**STRICT)
def _roomier(items, used, rays, rows, angles):
    """The same arrays with room for the rays of one more pole."""
    if rows + 6 * angles + WIDTH > rays.shape[1]:
        wider = np.empty((COLUMNS, 2 * rays.shape[1] + 6 * angles + WIDTH))
        for column in range(COLUMNS):
            for row in range(rows):
                wider[column, row] = rays[column, row]
        rays = wider
    if used + 4 * angles + 16 > items.shape[0]:
        larger = np.empty((2 * items.shape[0] + 4 * angles + 16, 8))
        for row in range(used):
            for column in range(8):
                larger[row, column] = items[row, column]
        items = larger
    return items, rays


@njit(**STRICT)
def _order(eta, p, x, rainbow):
    """The rays of order p, for spheres from x on; rainbow: pairs are made there, so that the dark side counts."""
    n = eta.real
    end = 0.5 * np.pi if n >= 1.0 else np.arcsin(n)
    last = turning(n, p, end)
    bow, top, reach, most = -1.0, max(last, 0.0), 0.0, np.inf
    curve = abs(last) / max(2.0 * abs(p / n - 1.0), 1e-6) / end, 0.0
    if p >= 2 and 1.0 < n < p:
        bow = np.arccos(np.sqrt((n * n - 1.0) / (p * p - 1.0)))
        top = turning(n, p, bow)
        # where the largest dark side has faded: exponent zeta^(3/2) 2/3, near the rainbow, with a margin
        h = 2.0 * (p * p - 1.0) / (p * p) * np.tan(bow)
        curve = np.sqrt(2.0 * top / h) / bow, np.sqrt(2.0 * (top - last) / h) / (end - bow)
        if rainbow:
            reach = min(REACH, (1.5 * FADED / x) ** (2.0 / 3.0) * np.cbrt(0.5 * h / np.cos(bow) ** 2))
            most = top - APART
    return Order(eta, p, end, last, bow, top, reach, most, curve)


@njit(**STRICT)
def _half_ring(order, lanes, pole, target, x, items, used, rays, rows):
    """Rays of one side of an end of the axis, written to `rays` and the pole's spans; items and rows that are used then."""
    first, stop, turns, sign = target
    bow, top, last, middle = order.bow, order.top, order.last, turns * np.pi
    side, number = 0 if sign > 0.0 else 1, turns - order.p + 1
    q, fold = sign, number // 2
    if pole.end < 0.0:
        q, fold = -sign, (number + 1) // 2 if side == 0 else (number - 1) // 2
    pole.kappas[side] = 0.5 * np.pi * (1.0 + order.p - 2.0 * fold - 0.5 * q)
    if order.reach > 0.0:
        a, b = _stretch(lanes.beta, first, stop, middle, sign, np.nextafter(top, 10.0 + top), top + order.reach)
        if b > a:
            c, d = _dark(order, lanes, Target(a, b, turns, sign), x, rays, rows)
            used = _emit(items, used, DARK, c, d - c, rows + c - a, -1, (pole.kappas[side], 1.0, pole.end))
            rows += b - a
    for part in range(2):
        span = pole.spans[part, side]
        if part == 1 and bow < 0.0:
            span[0], span[1] = -1, -1
            continue
        far = 0.0 if part == 0 and bow > 0.0 else last  # the anchor: the rainbow, or the axis
        low, high = (min(far, top), top) if bow > 0.0 else (min(last, 0.0), max(last, 0.0))
        a, b = _stretch(lanes.beta, first, stop, middle, sign, low, high)
        span[0], span[1], span[2] = a, b, rows
        if b > a:
            focus, curve = part == 0 and turns == 0, min(order.curve[part], 2.0)
            if bow > 0.0:
                segment = Segment(bow, top, order.rim if part == 1 else 0.0, far, True, focus, curve)
            else:
                segment = Segment(0.0, 0.0, order.rim, last, False, focus, curve)
            _lit(order, lanes, Target(a, b, turns, sign), segment, rays, rows)
            rows += b - a
    return used, rows


@njit(**STRICT)
def trace(m, theta, orders, rainbow, axis, x):
    """Rays of the orders p = 0..orders at theta (A,) rad, ascending; x: the smallest sphere that will ask.

    Returns
    -------
    items : (I, 8), columns KIND .. END: stretches of neighbouring angles with one kind of ray or pair
    rays : (COLUMNS, R), rows of `_surface`; those of a stretch follow each other
    """
    eta = np.conj(m)
    n = eta.real
    mirror = abs(eta) > 1e30
    count = theta.shape[0]
    w, o = np.zeros(ROWS * WIDTH), np.zeros(OUT_ROWS * WIDTH)
    items, rays = np.empty((16 * (orders + 1), 8)), np.empty((COLUMNS, (orders + 2) * count + WIDTH))
    beta, sine = np.empty(count), np.empty(count)
    half = 0
    for a in range(count):
        s, c = sincos(0.5 * theta[a])
        forward = theta[a] <= 0.5 * np.pi
        half += forward
        beta[a], sine[a] = max(theta[a] if forward else np.pi - theta[a], NEAREST), max(2.0 * s * c, NEAREST)
    for start in range(0, count, WIDTH):
        for j in range(WIDTH):
            w[T + j] = theta[min(start + j, count - 1)]
        outside(eta, mirror, w, o)
        _keep(o, min(WIDTH, count - start), rays, start, OF_REAL)
    used, rows = _emit(items, 0, SINGLE, 0, count, 0, -1, (0.25 * np.pi, -1.0, 1.0)), count
    if mirror or n <= 0.0:
        return items[:used], rays[:, :rows]
    lanes, spans, kappas, signs = Lanes(beta, sine, w, o), np.empty((2, 2, 3), np.int64), np.empty(2), np.empty(2)
    for p in range(1, orders + 1):
        order = _order(eta, p, x, rainbow)
        signs[0], signs[1] = (1.0 if order.bow > 0.0 or order.last > 0.0 else -1.0), -1.0
        for turns in range(int(np.floor(min(order.last, 0.0) / np.pi)) - 1, int(np.ceil((order.top + order.reach) / np.pi)) + 2):
            forward = (turns - p + 1) % 2 == 0
            first, stop = (0, half) if forward else (half, count)
            items, rays = _roomier(items, used, rays, rows, stop - first)
            pole = Pole(spans, kappas, signs, FOCUS if turns == 0 else SINGLE, 1.0 if forward else -1.0, rainbow, axis)
            for side in range(2):
                used, rows = _half_ring(order, lanes, pole, Target(first, stop, turns, 1.0 if side == 0 else -1.0), x,
                                        items, used, rays, rows)
            used = _gather(pole, first, stop, rays, items, used)
    return items[:used], rays[:, :rows]
