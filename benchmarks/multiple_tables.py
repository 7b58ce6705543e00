"""Tables of multiple scattering: error against bytes and time of a look-up, beside the lobes of Wang, Ge & Holzschuch (2020).

    python benchmarks/multiple_tables.py [lobes] [tree] [time]      all three if none is named; about three minutes

`lobes` draws docs/pictures/multiple_error_bytes.png.

Theirs: axially symmetric lobes (point) and asymmetric ones (segment) of 18 angles about the axis that halves the lobe best, at
the corners of an error-driven quadtree over (rho, z), logarithms blended from the four corners, integrals over directions made
exact.
Errors: relative L2 over the sphere, root mean square over places that neither was made from, against the same solution.
"""

import math
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent)]

import numpy as np  # noqa: E402
from numba import njit  # noqa: E402
from peers import interleaved  # noqa: E402

from bakery.physics.multiple import build, frame, legendre, locate, lookup, point, segment, solution  # noqa: E402
from bakery.physics.multiple.kinds import KINDS  # noqa: E402
from benchmarks.sizes import docs, sized  # noqa: E402

MEDIA = sized(((0.3, 0.99), (0.7, 0.95), (0.85, 0.97), (0.9, 0.93)), ((0.3, 0.99), (0.5, 0.95)))
TOLERANCES, CELLS = sized(((1e-2, 4e-3, 2e-3), (1000, 3000)), ((1e-2,), (600,)))
GRIDS = sized(((4e-3, 6), (2e-3, 6), (1e-3, 6), (0.0, 4), (0.0, 5), (0.0, 6)), ((4e-3, 5), (0.0, 4)))  # tolerance, finest level
ANGLES, SIDE, ROOT = 18, 32.0, 16  # samples of a lobe; the plane is SIDE x 2 SIDE, ROOT x 2 ROOT cells at first
THETA = (np.arange(ANGLES) + 0.5) * math.pi / ANGLES


class Lobes:
    """The paper's representation for one source."""

    def __init__(self, medium, kind, cells):
        self.kind, self.length = kind, build.LENGTH * kind
        self.corners, self.leaves, self.child = _quadtree(lambda rho, z: _light(medium, kind, self.length, rho, z), cells)
        rho, z = np.maximum(self.corners[:, 0], 1e-3), self.corners[:, 1]
        rho = np.where((z == 0) & (rho < 0.01), 0.02, rho)
        axis = np.arctan2(rho, z)
        c = (point.coefficients(medium, np.hypot(rho, z), axis) if kind == 0
             else segment.coefficients(medium, rho, z, self.length, axis))
        singular = locate.measure(kind, self.length, rho, z)[1]
        samples = [_lobe(*row, medium.order, kind == 0) for row in zip(c, _sections(c, medium.order), strict=True)]
        self.axis = axis - np.array([a for a, _ in samples])  # angle from +z
        self.values = np.log(np.maximum([f for _, f in samples], 1e-12)) - np.log(singular)[:, None, None]
        self.bytes = len(self.corners) * 4 * (ANGLES * (1 if kind == 0 else 3) + 1) + 20 * len(self.leaves)

    def look(self, rho, z, x, y, along):
        out = np.empty(len(rho))
        _look(self.kind, self.length, self.leaves, self.child, self.axis, self.values, rho, z, x, y, along, out)
        return out


def _light(medium, kind, length, rho, z):
    rho = np.maximum(rho, 0.02)
    light = (point.integral(medium, np.hypot(rho, z), np.arctan2(rho, z)) if kind == 0
             else segment.integral(medium, rho, z, length))
    return np.log(np.maximum(light / locate.measure(kind, length, rho, z)[1], 1e-30))


def _quadtree(light, cells):
    """Corners (C, 2); cells (M, 8): rho0, z0, width, height, four corners; first child (M,).  Divided where light is worst."""
    step = SIDE / ROOT
    boxes = [(i * step, j * step - SIDE, step) for i in range(ROOT) for j in range(2 * ROOT)]
    child, known = [-1] * len(boxes), {}

    def at(places):
        new = [p for p in places if p not in known]
        if new:
            known.update(zip(new, light(*np.array(new).T), strict=True))
        return np.array([known[p] for p in places])

    def miss(some):
        some = [boxes[n] for n in some]
        corners = [at([(r + a * w, z + b * w) for r, z, w in some]) for a, b in ((0, 0), (0, 1), (1, 0), (1, 1))]
        middle = light(*np.array([(r + w / 2, z + w / 2) for r, z, w in some]).T)
        # places count as in the error below: logarithmic in the distance
        near = np.array([w / max(math.hypot(r + w / 2, z + w / 2), 0.1) for r, z, w in some])
        return np.abs(middle - np.mean(corners, axis=0)) * near

    error = list(miss(range(len(boxes))))
    while sum(c < 0 for c in child) < cells:
        worst = [n for n in np.argsort(error)[::-1][:max(1, cells // 16)] if child[n] < 0 and boxes[n][2] > 1 / 64]
        if not worst:
            break
        for n in worst:
            r, z, w = boxes[n]
            child[n], error[n] = len(boxes), -1.0
            boxes += [(r + a * w / 2, z + b * w / 2, w / 2) for a in (0, 1) for b in (0, 1)]
            child += [-1] * 4
            error += list(miss(range(len(boxes) - 4, len(boxes))))
    index, rows = {}, []
    for (r, z, w), c in zip(boxes, child, strict=True):
        places = [(r, z), (r, z + w), (r + w, z), (r + w, z + w)]
        rows.append((r, z, w, *(index.setdefault(p, len(index)) if c < 0 else 0 for p in places)))
    return np.array(list(index)), np.array(rows), np.array(child)


def _sections(c, order):
    """Lobes (N, 360) in the plane of axis and source, every degree."""
    rings = point.harmonics(order, np.arange(181) * math.pi / 180).T
    m = np.concatenate([np.arange(l + 1) for l in range(order + 1)])
    here, there = (c * np.where(m > 0, 2, 1)) @ rings, (c * np.where(m > 0, 2, 1) * (-1.0) ** m) @ rings
    return np.concatenate([here, there[:, 179:0:-1]], axis=1)


def _lobe(c, section, order, axial):
    """Angle of the best axis from r^ towards +z, and 18 samples on each of three sides, with the lobe's own integral."""
    psi = np.arange(360) * math.pi / 180
    square = np.fft.irfft(np.fft.rfft(section) ** 2)
    n = int(np.argmax(square))
    low, mid, high = square[n - 1], square[n], square[(n + 1) % 360]
    axis = (n + 0.5 * (low - high) / (low - 2 * mid + high)) * math.pi / 360
    if np.interp(axis + math.pi, psi, section, period=2 * math.pi) > np.interp(axis, psi, section, period=2 * math.pi):
        axis += math.pi
    around = np.arange(12) * math.pi / 6 if axial else np.array([0.0, math.pi, math.pi / 2])
    t, a = np.meshgrid(THETA, around, indexing="ij")
    side, up, y = np.sin(t) * np.cos(a), np.cos(t), np.sin(t) * np.sin(a)
    forward, along = up * math.cos(axis) - side * math.sin(axis), up * math.sin(axis) + side * math.cos(axis)
    f = point.evaluate(c, order, np.arctan2(np.hypot(along, y), forward).ravel(), np.arctan2(y, along).ravel()).reshape(t.shape)
    f = np.repeat(f.mean(axis=1, keepdims=True), 3, axis=1) if axial else f
    total = 2 * math.pi * (np.maximum(f, 0) @ [0.25, 0.25, 0.5] * np.sin(THETA)).sum() * math.pi / ANGLES
    return axis, (f * c[0] * math.sqrt(4 * math.pi) / total).T


@njit(cache=True, nogil=True, error_model="numpy")
def _look(kind, length, cells, child, axis, values, rho, z, x, y, along, out):
    for n in range(len(out)):
        m, _, singular, _, _ = locate.place(kind, length, max(rho[n], frame.CLOSEST), z[n])
        r, h = min(rho[n], SIDE - 1e-9), min(max(z[n], -SIDE), SIDE - 1e-9)
        cell = int(r * ROOT / SIDE) * 2 * ROOT + int((h + SIDE) * ROOT / SIDE)
        while child[cell] >= 0:
            half = cells[cell, 2] / 2
            cell = child[cell] + 2 * int(r >= cells[cell, 0] + half) + int(h >= cells[cell, 1] + half)
        s, t = (r - cells[cell, 0]) / cells[cell, 2], (h - cells[cell, 1]) / cells[cell, 2]
        total = 0.0
        for corner in range(4):
            k = int(cells[cell, 3 + corner])
            share = (s if corner > 1 else 1 - s) * (t if corner % 2 else 1 - t)
            sine, cosine = math.sin(axis[k]), math.cos(axis[k])
            up, side = x[n] * sine + along[n] * cosine, along[n] * sine - x[n] * cosine
            flat = math.sqrt(side * side + y[n] * y[n])
            at = min(max(math.atan2(flat, up) * ANGLES / math.pi - 0.5, 0.0), ANGLES - 1.0)
            i = min(int(at), ANGLES - 2)
            at -= i
            a = values[k, 0, i] * (1 - at) + values[k, 0, i + 1] * at
            if kind == 1:
                b = math.exp(values[k, 1, i] * (1 - at) + values[k, 1, i + 1] * at - a)
                c = math.exp(values[k, 2, i] * (1 - at) + values[k, 2, i + 1] * at - a)
                turn = side / max(flat, 1e-12)
                a += math.log(max((1 + b + 2 * c) / 4 + (1 - b) / 2 * turn + (1 + b - 2 * c) / 4 * (2 * turn * turn - 1), 1e-3))
            total += share * a
        out[n] = singular * math.exp(total)


def error_of_lobes(lobes, medium, rho, z):
    polar, across, gauss = build.between_directions(medium.order)
    x = np.cos(polar)
    exact = point.lobes(build.coefficients(medium, lobes.kind, lobes.length, rho, z), medium.order, polar, across)
    axis = np.arctan2(rho, z)[:, None, None]
    flat = np.sqrt(1 - x * x)[:, None]
    up, side, y = x[:, None] + 0 * across, flat * np.cos(across), flat * np.sin(across)
    px, pz = up * np.sin(axis) - side * np.cos(axis), up * np.cos(axis) + side * np.sin(axis)
    wide = [np.ascontiguousarray(np.broadcast_to(a, px.shape)).ravel() for a in (rho[:, None, None], z[:, None, None], px, y, pz)]
    found = lobes.look(*wide).reshape(exact.shape)
    w = gauss[:, None]
    return np.sqrt((w * (found - exact) ** 2).sum(axis=(1, 2)) / (w * exact**2).sum(axis=(1, 2)))


def _rms(error):
    return 100 * math.sqrt((error**2).mean())


def _places(kind):
    rho, z = build.places(kind, build.LENGTH * kind, 30.0, np.random.default_rng(2024))
    return rho, z


def solved(g, albedo):
    return solution.solve(albedo, legendre.henyey_greenstein(g, 200))


def against_lobes():
    print("\n| g, albedo | source | ours: tolerance, kB, error | | | lobes: kB, error | |\n|---|---|---|---|---|---|---|")
    curves = {}
    for g, albedo in MEDIA:
        s = solved(g, albedo)
        for kind in (0, 1):
            rho, z = _places(kind)
            ours, theirs, row = [], [], []
            for tolerance in TOLERANCES:
                t = build.table(s, kind, extent=32.0, tolerance=tolerance)
                error = build.errors(t, s.medium, rho, z)
                ours.append((t.nbytes / 1e3, _rms(error)))
                row.append(f"{tolerance:g}: {t.nbytes / 1e3:.0f} kB, {_rms(error):.3f} % (stated {100 * t.error:.3f}, worst "
                           f"{100 * error.max():.1f})")
            for cells in CELLS:
                lobes = Lobes(s.medium, kind, cells)
                theirs.append((lobes.bytes / 1e3, _rms(error_of_lobes(lobes, s.medium, rho, z))))
                row.append("{:.0f} kB, {:.2f} %".format(*theirs[-1]))
            curves[g, kind] = ours, theirs
            print(f"| {g:g}, {albedo:g} | {KINDS[kind]} | " + " | ".join(row) + " |", flush=True)
    draw(curves)


def draw(curves):
    """Error against bytes: curves {(g, kind): (ours, theirs)}, each a list of kB and per cent."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, panels = pyplot.subplots(1, 2, figsize=(10, 4.4), sharey=True, sharex=True, layout="constrained")
    colours = dict(zip((g for g, _ in MEDIA), ("#0072b2", "#009e73", "#e69f00", "#d55e00"), strict=False))
    for kind, panel in enumerate(panels):
        for (g, of), (ours, theirs) in curves.items():
            if of == kind:
                panel.loglog(*zip(*ours), "o-", color=colours[g], label=f"g = {g:g}")
                panel.loglog(*zip(*theirs), "s--", color=colours[g], markerfacecolor="white")
        panel.set(title=f"{KINDS[kind]} source", xlabel="bytes of one wavelength, kB", xlim=(25, 1100))
        panel.set_xticks([30, 100, 300, 1000], ["30", "100", "300", "1000"])
        panel.set_xticks([], minor=True)
        panel.grid(alpha=0.3, which="both")
    panels[0].set_ylabel("error of a lobe, rms over directions and places, %")
    panels[1].plot([], [], "ko-", label="tables")
    panels[1].plot([], [], "ks--", markerfacecolor="white", label="axial / asymmetric lobes")
    panels[1].legend(fontsize=8, loc="upper left")
    path = docs() / "pictures" / "multiple_error_bytes.png"
    figure.savefig(path, dpi=110)
    print(f"\n{path}")


def tree():
    """The tree against uniform grids of its own cells, with the same basis at most."""
    print("\n| g, albedo | source | tree: corners, error | | | uniform: corners, error | | |\n|---|---|---|---|---|---|---|---|")
    for g, albedo in MEDIA[1::2]:
        s = solved(g, albedo)
        for kind in (0, 1):
            rho, z = _places(kind)
            row = []
            for tolerance, finest in GRIDS:
                t = build.table(s, kind, extent=32.0, tolerance=tolerance, finest=finest, most=23)
                row.append(f"{len(t.corner)}, {_rms(build.errors(t, s.medium, rho, z)):.3f} %")
            print(f"| {g:g}, {albedo:g} | {KINDS[kind]} | " + " | ".join(row) + " |", flush=True)


def time(count=sized(300_000, 500)):
    """One look-up on one core, places and directions without order."""
    print("\n| g, albedo | source | ours, ns | lobes, ns | ratio |\n|---|---|---|---|---|")
    random = np.random.default_rng(1)
    r, mu = np.exp(random.uniform(math.log(0.1), math.log(30), count)), random.uniform(-1, 1, count)
    rho, z = r * np.sqrt(1 - mu * mu), r * mu
    theta, phi = np.arccos(random.uniform(-1, 1, count)), random.uniform(0, 2 * math.pi, count)
    x, y, along = np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)
    for g, albedo in MEDIA[1::2]:
        s = solved(g, albedo)
        ready = [lookup.ready(build.table(s, kind, extent=32.0)) for kind in (0, 1)]
        lobes = [Lobes(s.medium, kind, sized(1200, 600)) for kind in (0, 1)]
        looks = ((lambda: lookup.point(ready[0], rho, z, theta, phi)), (lambda: lookup.segment(*ready, rho, z, theta, phi)))
        for kind in (0, 1):
            seconds = interleaved({"ours": looks[kind], "lobes": lambda: lobes[kind].look(rho, z, x, y, along)}, 15)
            ours, theirs = (seconds[name] / count * 1e9 for name in ("ours", "lobes"))
            print(f"| {g:g}, {albedo:g} | {KINDS[kind]} | {ours:.0f} | {theirs:.0f} | {ours / theirs:.2f} |", flush=True)


if __name__ == "__main__":
    parts = {"lobes": against_lobes, "tree": tree, "time": time}
    for name in sys.argv[1:] or parts:
        parts[name]()
