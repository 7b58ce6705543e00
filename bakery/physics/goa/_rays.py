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

from __future__ import annotations

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
def _lit(eta, p, beta, sine, first, last, turns, sign, most, segment, bow, focus, curve, w, o, rays, row):
    """Rays of one segment for the angles first..last, rows from `row`.

    turns pi + sign beta: their turning, at most `most`; segment: t and turning at its anchor and at its far end; bow: the anchor
    is a rainbow; focus: the axial ray is among them; curve: share of the linear part of the guess.
    """
    side = -1.0 if (segment[2] - segment[0]) * (segment[3] - segment[1]) > 0.0 else 1.0
    low, high = min(segment[0], segment[2]), max(segment[0], segment[2])
    for start in range(first, last, WIDTH):
        count = min(WIDTH, last - start)
        for j in range(WIDTH):
            i = start + min(j, count - 1)
            w[B + j], o[SINE * WIDTH + j] = beta[i], sine[i]
        for j in range(WIDTH):
            turned = turns * np.pi + sign * w[B + j]
            turned = turned if turned < most else most
            y = (turned - segment[1]) / (segment[3] - segment[1])
            y = y if y > 0.0 else 0.0
            y = np.sqrt(y) if bow else y
            w[B + j] = 0.5 * turned
            w[T + j] = segment[0] + (segment[2] - segment[0]) * y * (curve + (1.0 - curve) * y)
        real_rays(eta.real, p, side, low, high, w)
        real(eta, p, bow, focus, w, o)
        _keep(o, count, rays, row + start - first, OF_REAL)


@njit(**STRICT)
def _dark(eta, p, beta, sine, first, last, turns, sign, least, bow, x, w, o, rays, row):
    """Complex rays for the angles first..last, whose turning is beyond that of the rainbow, `least`.

    Rows from `row` for all angles; returns the stretch of angles whose rays exist, not all faded for the sphere x.
    """
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
def _emit(items, used, kind, angle, count, row, partner, kappa, sign, end):
    item = items[used]
    item[KIND], item[ANGLE], item[COUNT], item[ROW], item[PARTNER] = kind, angle, count, row, partner
    item[KAPPA], item[SIGN], item[END] = kappa, sign, end
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
def _gather(spans, kappas, signs, kind, end, rainbow, axis, first, last, rays, items, used):
    """Items of the rays of one pole, cut where pairs change: spans (2, 2, 3), first and last angle and row of part and side."""
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
                used = _emit(items, used, AXIS, first, count, _row(spans, k, 0, first), _row(spans, k, 1, first), kappas[0],
                             signs[k], end)
                present[k, 0], present[k, 1] = False, False
        for k in range(2):
            if pairs & (4 << k):
                used = _emit(items, used, RAINBOW, first, count, _row(spans, 0, k, first), _row(spans, 1, k, first), kappas[k],
                             1.0, end)
                present[0, k], present[1, k] = False, False
        for part in range(2):
            for side in range(2):
                if present[part, side]:
                    used = _emit(items, used, kind if part == 0 else SINGLE, first, count, _row(spans, part, side, first), -1,
                                 kappas[side], signs[part], end)
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
        more = np.empty((2 * items.shape[0] + 4 * angles + 16, 8))
        for row in range(used):
            for column in range(8):
                more[row, column] = items[row, column]
        items = more
    return items, rays


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
    used, rows = _emit(items, 0, SINGLE, 0, count, 0, -1, 0.25 * np.pi, -1.0, 1.0), count
    if mirror or n <= 0.0:
        return items[:used], rays[:, :rows]
    end = 0.5 * np.pi if n >= 1.0 else np.arcsin(n)
    spans, kappas, signs = np.empty((2, 2, 3), np.int64), np.empty(2), np.empty(2)
    for p in range(1, orders + 1):
        last = turning(n, p, end)
        bow, top, reach, least = -1.0, max(last, 0.0), 0.0, np.inf
        curve = abs(last) / max(2.0 * abs(p / n - 1.0), 1e-6) / end, 0.0
        if p >= 2 and 1.0 < n < p:
            bow = np.arccos(np.sqrt((n * n - 1.0) / (p * p - 1.0)))
            top = turning(n, p, bow)
            # where the largest dark side has faded: exponent zeta^(3/2) 2/3, near the rainbow, with a margin
            h = 2.0 * (p * p - 1.0) / (p * p) * np.tan(bow)
            curve = np.sqrt(2.0 * top / h) / bow, np.sqrt(2.0 * (top - last) / h) / (end - bow)
            if rainbow:
                reach = min(REACH, (1.5 * FADED / x) ** (2.0 / 3.0) * np.cbrt(0.5 * h / np.cos(bow) ** 2))
                least = top - APART
        signs[0], signs[1] = (1.0 if bow > 0.0 or last > 0.0 else -1.0), -1.0
        for turns in range(int(np.floor(min(last, 0.0) / np.pi)) - 1, int(np.ceil((top + reach) / np.pi)) + 2):
            pole = turns - p + 1
            forward = pole % 2 == 0
            first, stop = (0, half) if forward else (half, count)
            middle, kind = turns * np.pi, FOCUS if turns == 0 else SINGLE
            items, rays = _roomier(items, used, rays, rows, stop - first)
            for side in range(2):
                sign = 1.0 if side == 0 else -1.0
                q, fold = (sign, pole // 2) if forward else (-sign, (pole + 1) // 2 if side == 0 else (pole - 1) // 2)
                kappas[side] = 0.5 * np.pi * (1.0 + p - 2.0 * fold - 0.5 * q)
                if reach > 0.0:
                    a, b = _stretch(beta, first, stop, middle, sign, np.nextafter(top, 10.0 + top), top + reach)
                    if b > a:
                        c, d = _dark(eta, p, beta, sine, a, b, turns, sign, top, bow, x, w, o, rays, rows)
                        used = _emit(items, used, DARK, c, d - c, rows + c - a, -1, kappas[side], 1.0, 1.0 if forward else -1.0)
                        rows += b - a
                for part in range(2):
                    if part == 1 and bow < 0.0:
                        spans[part, side, 0], spans[part, side, 1] = -1, -1
                        continue
                    far = 0.0 if part == 0 and bow > 0.0 else last  # the anchor: the rainbow, or the axis
                    low, high = (min(far, top), top) if bow > 0.0 else (min(last, 0.0), max(last, 0.0))
                    a, b = _stretch(beta, first, stop, middle, sign, low, high)
                    spans[part, side, 0], spans[part, side, 1], spans[part, side, 2] = a, b, rows
                    if b > a:
                        segment = (bow, top, end if part == 1 else 0.0, far) if bow > 0.0 else (0.0, 0.0, end, last)
                        _lit(eta, p, beta, sine, a, b, turns, sign, least, segment, bow > 0.0, part == 0 and turns == 0,
                             min(curve[part], 2.0), w, o, rays, rows)
                        rows += b - a
            used = _gather(spans, kappas, signs, kind, 1.0 if forward else -1.0, rainbow, axis, first, stop, rays, items, used)
    return items[:used], rays[:, :rows]
