"""Scattering of light by one sphere, homogeneous or in a concentric shell: Lorenz-Mie theory.

Conventions: time factor exp(-i w t), m = n + ik with k >= 0 relative to the host, x = 2 pi r n_host/lambda_vacuum, S1
perpendicular and S2 parallel to the scattering plane (Bohren & Huffman 1983).  Range and measured errors: docs/mie.md.
"""

import os
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import numpy as np

X_MIN, X_MAX = 1e-12, 2e6
M_MIN, M_MAX = 1e-4, 1e4
MANY_ANGLES, SMALLEST = 400, 50.0  # from which number of angles and size on amplitudes come from a transform: else it is slower
PHASE_MAX = 2e9  # |m| x: one step of a recurrence each, 5 ns


def efficiencies(m, x):
    """Efficiencies and asymmetry of spheres.

    Parameters
    ----------
    m : complex, n + ik with k >= 0, relative to the host; `inf` is a perfect conductor
    x : size parameter, 1e-12 to 2e6; m and x broadcast

    Returns
    -------
    q_ext, q_sca, q_back, g : of the broadcast shape, floats for scalars; 1.  Cross sections over pi r^2,
        q_back = 4 |S1(pi)|^2/x^2, g the mean cosine of the scattering angle (0 where nothing scatters, m = 1)

    Raises
    ------
    ValueError : an x out of range, gain (k < 0), an index that is no passive material's

    Notes
    -----
    Relative error 1e-15 to 1e-13 (x = 1e6), also as x -> 0 and m -> 1; q_back 1e-16 x.  q_ext is the sum of q_sca and q_abs, so
    it never falls below q_sca.  Source: Bohren & Huffman 1983, eqs. 4.61, 4.62 and 4.88.

    Examples
    --------
    >>> q_ext, q_sca, q_back, g = efficiencies(1.33, 10.0)
    >>> round(q_ext, 10)
    2.2065487102
    """
    q_ext, q_sca, _, q_back, g = _all_efficiencies(m, x)
    return q_ext, q_sca, q_back, g


def absorption(m, x):
    """Absorption efficiency, not formed as the difference of extinction and scattering.

    Parameters, errors and range as `efficiencies`.  Keeps its relative accuracy however weak the absorption is (k = 1e-16).

    Returns
    -------
    q_abs : of the broadcast shape; 1

    Notes
    -----
    Re a_n - |a_n|^2 = Im A_n/|N_n - i M_n|^2 by the Wronskian, a sum of terms of one sign (`_kernels`).
    """
    return _all_efficiencies(m, x)[2]


def amplitudes(m, x, theta):
    """Scattering amplitudes of spheres.

    Parameters
    ----------
    m, x : as `efficiencies`, any shapes that broadcast
    theta : any shape; rad, 0 (forward) to pi.  The angle, not its cosine, which has lost the forward peak of large spheres

    Returns
    -------
    S1, S2 : complex, shape broadcast(m, x).shape + theta.shape

    Raises
    ------
    ValueError : as `efficiencies`, or an angle outside 0 to pi

    Notes
    -----
    Error relative to the local maximum of |S|: 2e-16 max(x, 30), most of it the last bit of theta.
    Source: Bohren & Huffman 1983, eq. 4.74.

    Examples
    --------
    >>> S1, S2 = amplitudes(1.5, 3.0, np.array([0.0, np.pi]))
    >>> bool(S1[0] == S2[0]), bool(abs(S1[1] + S2[1]) < 1e-14)
    (True, True)
    """
    shape, m, x = checked(m, x)
    theta, angles = _checked_angles(theta)
    s1, s2 = np.empty((2, x.size, angles.size), dtype=np.complex128)
    jobs = []
    for index, places in by_index(m, x):
        small = places.size
        if angles.size >= MANY_ANGLES:
            small = np.searchsorted(x[places], SMALLEST)
            jobs += _by_transform(index, x, angles, places[small:], s1, s2)
        jobs += _by_recurrence(index, x, angles, places[:small], s1, s2)
    in_threads(lambda job: job(), jobs)
    return s1.reshape(shape + theta.shape)[()], s2.reshape(shape + theta.shape)[()]


def _by_recurrence(index, x, angles, places, s1, s2):
    """Jobs that fill s1, s2 at some spheres by a recurrence an angle."""
    from bakery.physics.mie import angular, coefficients

    def run(places, part):
        piece = np.empty((min(places.size, coefficients.LANES), angles[part].size, 4))
        for block in np.split(places, range(coefficients.LANES, places.size, coefficients.LANES)):  # stays in the cache
            angular.amplitude_block(index, x[block], angles[part], piece[:block.size])
            pair = piece[:block.size].view(np.complex128)
            s1[block, part], s2[block, part] = pair[..., 0], pair[..., 1]

    if not places.size:
        return []
    work = np.cumsum(x[places] + 10.0) * max(angles.size, 1)
    parts = parts_of_work(work[-1] * 2e-10)
    if places.size >= 4 * parts:  # radii among the threads; else angles
        pieces = np.split(places, np.searchsorted(work, work[-1] * np.arange(1, parts) / parts))
        return [partial(run, piece, slice(None)) for piece in pieces if piece.size]
    edges = np.linspace(0, angles.size, parts + 1).astype(int)
    return [partial(run, places, slice(a, b)) for a, b in zip(edges[:-1], edges[1:]) if b > a]


def _by_transform(index, x, angles, places, s1, s2):
    """Jobs that do so by `fourier`."""
    from bakery.physics.mie import fourier

    def run(blocks):
        for grid, block in blocks:
            if np.all(np.diff(block) == 1):
                rows = slice(block[0], block[-1] + 1)
                fourier.amplitudes_of_block(index, x[block], angles, grid, s1[rows], s2[rows])
            else:
                pair = np.empty((2, block.size, angles.size), dtype=np.complex128)
                fourier.amplitudes_of_block(index, x[block], angles, grid, *pair)
                s1[block], s2[block] = pair

    if not places.size:
        return []
    blocks = fourier.blocks(x, places)
    work = np.cumsum([x[block].sum() + 0.4 * angles.size * block.size for _, block in blocks])
    parts = parts_of_work(work[-1] * 7e-8 / 10)  # memory of a new thread costs some ms: not for less than ten
    cuts = [0, *np.searchsorted(work, work[-1] * np.arange(1, parts) / parts), len(blocks)]
    return [partial(run, blocks[a:b]) for a, b in zip(cuts[:-1], cuts[1:]) if b > a]


def coated_efficiencies(core, shell, x, y):
    """Efficiencies and asymmetry of spheres in a concentric shell.

    Parameters
    ----------
    core, shell : complex, n + ik with k >= 0, relative to the host
    x : size parameter of the core, 0 (none) to y
    y : size parameter of the whole sphere, 1e-12 to 2e6; all four broadcast

    Returns
    -------
    q_ext, q_sca, q_abs, q_back, g : of the broadcast shape, floats for scalars; 1.  Cross sections over the whole sphere's pi r^2

    Raises
    ------
    ValueError : as `efficiencies`, or a core that is larger than the whole

    Notes
    -----
    Relative error 1e-15 to 1e-12 (docs/mie.md); where both indices are within some 1e-3 of 1 it grows like 1e-16/|m - 1|.  With
    no core, no shell, or a core of the shell's index they are those of `efficiencies`.
    Source: Bohren & Huffman 1983, section 8.1.

    Examples
    --------
    >>> q_ext, q_sca, q_abs, q_back, g = coated_efficiencies(1.59 + 0.66j, 1.409 + 0.1747j, 0.35814156, 13.12138532)
    >>> round(q_ext, 5), round(q_sca, 5)
    (2.32803, 1.14341)
    """
    from bakery.physics.mie import coated

    shape, groups, x, y = _checked_layers(core, shell, x, y)
    out = np.empty((5, y.size))
    for inner, outer, at in groups:
        piece = np.empty((5, at.size))
        coated.coated_efficiency_block(inner, outer, x[at], y[at], piece[0], piece[1], piece[2], piece[3], piece[4])
        out[:, at] = piece
    return tuple(row.reshape(shape)[()] if shape else float(row[0]) for row in out)


def coated_amplitudes(core, shell, x, y, theta):
    """Scattering amplitudes of spheres in a concentric shell.

    Parameters
    ----------
    core, shell, x, y : as `coated_efficiencies`
    theta : any shape; rad, 0 (forward) to pi

    Returns
    -------
    S1, S2 : complex, broadcast shape of the first four + theta.shape

    Raises
    ------
    ValueError : as `coated_efficiencies`, or an angle outside 0 to pi
    """
    from bakery.physics.mie import coated

    shape, groups, x, y = _checked_layers(core, shell, x, y)
    theta, angles = _checked_angles(theta)
    out = np.empty((y.size, angles.size, 4))
    for inner, outer, at in groups:
        piece = np.empty((at.size, angles.size, 4))
        coated.coated_angles(inner, outer, x[at], y[at], np.ones(at.size), angles, 0, piece)
        out[at] = piece
    pair = out.view(np.complex128)
    return pair[..., 0].reshape(shape + theta.shape)[()], pair[..., 1].reshape(shape + theta.shape)[()]


def _checked_layers(core, shell, x, y):
    """Broadcast shape, (core, shell, places) of each pair of indices, x and y as flat arrays."""
    try:
        core, shell, x, y = np.broadcast_arrays(*(np.asarray(part, kind) for part, kind in zip(
            (core, shell, x, y), (np.complex128, np.complex128, np.float64, np.float64))))
    except (TypeError, ValueError):
        raise ValueError("indices and size parameters of coated spheres are numbers or arrays that broadcast") from None
    shape, x = y.shape, x.reshape(-1)
    checked(core, y)
    _, outer, whole = checked(shell, y)
    for name, index in (("core", core), ("shell", shell)):
        if np.isinf(index).any():
            raise ValueError(f"{name} = inf: a perfect conductor has no shell, and is none; a metal such as 0.055+3.42i would do")
    bad = ~((x >= 0.0) & (x <= whole))
    if bad.any():
        raise ValueError(f"x = {x[bad][0]:g}: that of a core lies between 0 and that of the whole, y = {whole[bad][0]:g}")
    pairs = np.stack([core.reshape(-1), outer], axis=1)
    kinds, group = np.unique(pairs, axis=0, return_inverse=True)
    group = group.reshape(-1)
    groups = [(complex(kind[0]), complex(kind[1]), np.flatnonzero(group == i)) for i, kind in enumerate(kinds)]
    return shape, groups, x, whole


def _all_efficiencies(m, x):
    """q_ext, q_sca, q_abs, q_back, g of the broadcast shape."""
    from bakery.physics.mie import coefficients

    shape, m, x = checked(m, x)
    out = np.empty((5, x.size))
    jobs = []
    for index, places in by_index(m, x):
        work = np.cumsum(x[places] + 10.0)
        parts = min(parts_of_work(work[-1] * 2e-9), places.size)
        cuts = np.searchsorted(work, work[-1] * np.arange(1, parts) / parts) // coefficients.LANES * coefficients.LANES
        jobs += [(index, piece) for piece in np.split(places, cuts) if piece.size]

    def run(job):
        index, places = job
        if places[-1] - places[0] == places.size - 1 and np.all(np.diff(places) == 1):  # as where x ascends: nothing is copied
            rows = slice(places[0], places[-1] + 1)
            coefficients.efficiency_block(index, np.ascontiguousarray(x[rows]), *out[:, rows])
            return
        piece = np.empty((5, places.size))
        coefficients.efficiency_block(index, x[places], *piece)
        out[:, places] = piece

    in_threads(run, jobs)
    return tuple(row.reshape(shape)[()] if shape else float(row[0]) for row in out)


def _checked_angles(theta):
    """theta as an array, and flat; ValueError where an angle is none."""
    theta = np.asarray(theta, dtype=np.float64)
    angles = np.ascontiguousarray(theta.reshape(-1))
    bad = ~((angles >= 0.0) & (angles <= np.pi))
    if bad.any():
        raise ValueError(f"theta = {angles[bad][0]:g}: scattering angles are in radians, 0 (forward) to pi (backward)")
    return theta, angles


def checked(m, x):
    """Broadcast shape, m and x as flat arrays; raises ValueError on what no sphere has."""
    try:
        m, x = np.asarray(m, dtype=np.complex128), np.asarray(x, dtype=np.float64)
    except (TypeError, ValueError):
        raise ValueError(f"m and x are numbers or arrays of numbers (m = n + ik, x real), found m = {m!r}, x = {x!r}") from None
    try:
        m, x = np.broadcast_arrays(m, x)
    except ValueError:
        raise ValueError(f"m of shape {m.shape} and x of shape {x.shape} do not broadcast") from None
    shape, m, x = x.shape, m.reshape(-1), x.reshape(-1)

    def refuse(bad, values, why):
        if bad.any():
            value = values[bad][0]
            text = f"{value.real:g}" + (f"{value.imag:+g}i" if value.imag else "")
            raise ValueError(f"{'x' if values is x else 'm'} = {text}: {why}")

    distinct = m[:1] if m.strides == (0,) else m  # a number that was spread over all sizes
    conductor = np.isinf(distinct.real) & (distinct.real > 0.0) & (distinct.imag == 0.0)
    refuse(~((x >= X_MIN) & (x <= X_MAX)), x, f"size parameters from {X_MIN:g} to {X_MAX:g} are computed")
    refuse(~np.isfinite(distinct) & ~conductor, distinct,
           "an index is finite; only inf itself, without imaginary part, is a perfect conductor")
    refuse(distinct.imag < 0.0, distinct, "k < 0 is gain here; with exp(-iwt) absorption is k > 0, so give the complex conjugate")
    refuse(distinct.real < 0.0, distinct, "n is not negative for non-magnetic materials (a metal is, for example, 0.055+3.42i)")
    size = np.where(conductor, 1.0, abs(distinct))
    refuse((size < M_MIN) | (size > M_MAX), distinct, f"|m| from {M_MIN:g} to {M_MAX:g} is computed; a perfect conductor is inf")
    refuse(size * x > PHASE_MAX, m, f"|m| x above {PHASE_MAX:g} is not computed: make x or |m| smaller")
    return shape, m, x


def by_index(m, x):
    """(index, places of its spheres in ascending order of x), one for each distinct index."""
    if m.size and np.all(m == m[0]):
        return [(complex(m[0]), np.argsort(x, kind="stable"))]
    values, group = np.unique(m, return_inverse=True)
    order = np.lexsort((x, group))
    starts = np.searchsorted(group[order], np.arange(values.size + 1))
    return [(complex(value), order[a:b]) for value, a, b in zip(values, starts[:-1], starts[1:])]


def _cores():
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def parts_of_work(seconds):
    """Into how many threads so much work is cut: one where starting them would cost more than it saves."""
    return _cores() if seconds > 1e-3 else 1


def in_threads(run, jobs):
    """Every job once; they write to disjoint places, so their order is of no consequence."""
    if len(jobs) < 2 or _cores() == 1:
        for job in jobs:
            run(job)
        return
    with ThreadPoolExecutor(min(len(jobs), _cores())) as pool:
        list(pool.map(run, jobs))
