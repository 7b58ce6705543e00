"""Fig. 2: how many chords p inside the sphere matter."""

import numpy as np

from bakery import goa

from . import measures as of
from . import printed

ORDERS = (1, 2, 3, 6, 20)
RADII = (1.0, 10.0, 100.0, 1000.0)
MANY = 100
OURS = (1, 2, 3, 6, 10, 20)


def energy_beyond(m, p, nodes=400):
    """Share of the light on a sphere that leaves after more than p chords: mean of (1 - R) R^p over sin^2 t, polarisations."""
    node, weight = np.polynomial.legendre.leggauss(nodes)
    end = np.pi / 2 if m >= 1 else np.arcsin(m)
    t = 0.5 * end * (node + 1)
    cos, cos_in = np.cos(t), np.sqrt(1 - (np.sin(t) / m) ** 2)
    r1, r2 = (cos - m * cos_in) / (cos + m * cos_in), (m * cos - cos_in) / (m * cos + cos_in)
    return float(sum(np.sum(weight * (1 - r * r) * r ** (2 * p) * np.sin(2 * t)) for r in (r1, r2)) * end / 4)


def of_rays(m, radius):
    """For each number of orders: (RelMSE against p = 100 of the same rays, pointwise and global; rms log10 against Mie)."""
    x = of.size_parameter(radius) * of.SINGLE
    exact = [of.exact(m, x[i:i + 1], np.ones(1), of.THETA) for i in range(x.size)]
    fields = {p: printed.amplitudes(m, x, of.THETA, p) for p in (MANY, *ORDERS)}
    most = of.mean_amplitude(*fields[MANY])
    rows = {}
    for p, (s1, s2) in fields.items():
        itself = np.mean([of.relative_square(a, b) for a, b in zip(of.mean_amplitude(s1, s2), most)], axis=0)
        log = np.mean([of.rms_log10(0.5 * (abs(a) ** 2 + abs(b) ** 2), e) for a, b, e in zip(s1, s2, exact)])
        rows[p] = (*itself, float(log))
    return dict(sorted(rows.items()))


def ours(m, radius, orders=OURS):
    """rms log10 against Mie of `bakery.goa` with the wide edge, for each number of orders."""
    x, one, errors = of.size_parameter(radius) * of.SINGLE, np.ones(1), []
    exact = [of.exact(m, x[i:i + 1], one, of.THETA) for i in range(x.size)]
    out = np.empty(of.THETA.size)
    for p in orders:
        row = []
        for i in range(x.size):
            goa.intensity_block(m, x[i:i + 1], one, of.THETA, out, p, edge="wide")
            row.append(of.rms_log10(out, exact[i]))
        errors.append(float(np.mean(row)))
    return errors


def measure():
    names = ("water", "glass", "bubbles")
    found = of.together(lambda name: [of_rays(of.INDICES[name], radius) for radius in RADII], [(name,) for name in names])
    rows = {(name, radius): row for name, part in zip(names, found) for radius, row in zip(RADII, part)}
    corrected = dict(zip(names, of.together(lambda name: ours(of.INDICES[name], 1000.0), [(name,) for name in names])))
    curve = {p: of.mean_amplitude(*printed.amplitudes(1.33, of.size_parameter(10.0), of.THETA, p))[0] for p in (1, 3, MANY)}
    from bakery.physics.mie import amplitudes

    curve["Mie"] = of.mean_amplitude(*amplitudes(1.33, of.size_parameter(10.0), of.THETA))
    return dict(rows=rows, ours=corrected, curve=curve)


def tables(numbers):
    body = []
    for (name, radius), row in numbers["rows"].items():
        body.append([name, f"{radius:g}", f"{of.short(row[3][0])} / {of.short(row[3][1])}",
                     *(of.short(row[p][2]) for p in (1, 3, 6, MANY))])
    spheres = of.table(["", "radius, µm", "RelMSE of p = 3 against 100: pointwise / global",
                        "rms log10 against Mie: p = 1", "p = 3", "p = 6", "p = 100"], body)
    corrected = of.table(["corrected, wide edge, 1000 µm: rms log10", *(f"p = {p}" for p in OURS)],
                         [[name, *(of.short(value) for value in row)] for name, row in numbers["ours"].items()])
    return {"fig2": f"{spheres}\n\n{corrected}"}


def draw(numbers):
    import matplotlib.pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(9.2, 3.5))
    degrees = np.rad2deg(of.THETA)
    for key, label, colour, style in (("Mie", "Lorenz-Mie", of.INK, "-"), (1, "rays, p ≤ 1", "#8a8f98", "-"),
                                      (MANY, "rays, p ≤ 100", "#c99a06", "-"), (3, "rays, p ≤ 3", "#c2410c", "--")):
        left.semilogy(degrees, numbers["curve"][key], style, color=colour, label=label, lw=1.1)
    left.set(xlabel="scattering angle, degrees", ylabel="(|S1| + |S2|)/2", title="Water, radius 10 µm",
             xlim=(0, 180), ylim=(2, 2e4))
    left.legend(ncol=2)
    for name in ("water", "glass", "bubbles"):
        row = numbers["rows"][name, 1000.0]
        colour = of.OF_INDEX[name]
        right.loglog(list(row), [value[2] for value in row.values()], "o--", ms=3, color=colour, label=f"{name}, as printed")
        right.loglog(OURS, numbers["ours"][name], "s-", ms=3, color=colour, label=f"{name}, corrected")
    right.axvline(3, color="#5d6875", lw=0.8)
    right.set(xlabel="highest number of chords p", ylabel="rms log10 of intensity against Mie", title="Radius 1000 µm")
    right.set_xticks([1, 3, 10, 30, 100], ["1", "3", "10", "30", "100"])
    right.legend(fontsize=8)
    return figure
