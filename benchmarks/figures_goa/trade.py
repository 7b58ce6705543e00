"""Fig. 6: error and time against radius, and the radius from which rays may replace the series."""

import time

import numpy as np

from bakery import goa
from bakery.physics.mie import amplitudes as mie_amplitudes
from bakery.physics.mie import angular as mie
from benchmarks.sizes import sized

from . import measures as of
from . import plain_mie, printed

RADII = np.geomspace(1.0, 1000.0, sized(16, 4))
FINE = np.geomspace(1.0, 1000.0, sized(61, 4))  # RelMSE scatters from radius to radius
LIMITS = (0.1, 0.03, 0.01)
SWITCH = 2.0  # um, the paper's
TIMED = sized((2.0, 5.0, 10.0, 30.0, 100.0, 300.0, 1000.0, 3000.0), (2.0, 10.0, 30.0))
ANGLES, TOGETHER = sized((1801, 64), (91, 4))
PAIRS = {  # ratio: (series, rays)
    "angle by angle / rays": ("plain, angle by angle", "rays"),
    "plain / rays": ("plain", "rays"),
    "vectorised / rays": ("vectorised", "rays"),
    "vectorised / corrected": ("vectorised", "corrected"),
    "vectorised / corrected, 64 sizes": ("vectorised, 64", "corrected, 64"),
}


def relative_squares(m, radius):
    """The paper's metric, single spheres: RelMSE of (|S1| + |S2|)/2, mean over 360 angles and global ratio.

    The global ratio is taken on angles that resolve the forward peak, which makes most of it; on the 360 alone it would jump by
    a factor of 20 above 60 um with what part of a diffraction ring falls on the first of them.
    """
    sizes, rows, cut = of.size_parameter(radius) * of.SINGLE, [], of.THETA.size
    theta = of.sphere_grid(sizes[-1])
    both, step = np.concatenate([of.THETA, theta]), np.gradient(theta)
    for x in sizes:
        exact = of.mean_amplitude(*mie_amplitudes(m, x, both))
        found = of.mean_amplitude(*printed.amplitudes(m, x, both))[0]
        point = of.relative_square(found[:cut], exact[:cut])[0]
        rows.append((point, np.sum((found - exact)[cut:] ** 2 * step) / np.sum(exact[cut:] ** 2 * step)))
    return tuple(float(v) for v in np.mean(rows, axis=0))


def pattern_errors(m, radius, averaged, variants=tuple(of.VARIANTS)):
    """{variant: (rms log10 on 360 angles, L1 of the phase function on a grid that resolves the forward peak)}."""
    sizes = [of.log_normal(radius)] if averaged else [(v, np.ones(1)) for v in (of.size_parameter(radius) * of.SINGLE)[:, None]]
    rows, cut = {variant: [] for variant in variants}, of.THETA.size
    theta = of.sphere_grid(max(x.max() for x, _ in sizes))
    both = np.concatenate([of.THETA, theta])
    for x, weight in sizes:
        exact = of.exact(m, x, weight, both)
        for variant in variants:
            found = of.found(variant, m, x, weight, both)
            rows[variant].append((of.rms_log10(found[:cut], exact[:cut]), of.l1(found[cut:], exact[cut:], theta)))
    return {variant: tuple(float(v) for v in np.mean(row, axis=0)) for variant, row in rows.items()}


def in_turn(jobs, rounds):
    """Median seconds of the processor that each job takes, one call each in turn; all of them run in the calling thread."""
    taken = {name: [] for name in jobs}
    for job in jobs.values():
        job()
    for _ in range(rounds):
        for name, job in jobs.items():
            start = time.thread_time()
            job()
            taken[name].append(time.thread_time() - start)
    return {name: float(np.median(values)) for name, values in taken.items()}


def seconds(radius, m=1.33):
    """Seconds a sphere of each program, at 1801 angles."""
    x, theta = float(of.size_parameter(radius)), np.linspace(0, np.pi, ANGLES)
    many, one = np.linspace(0.8, 1.2, TOGETHER) * x, np.ones(1)
    weight, out, single = np.ones(TOGETHER), np.empty(ANGLES), np.array([x])
    s1, s2 = np.empty((2, ANGLES), dtype=np.complex128)
    jobs = {
        "vectorised": lambda: mie.intensity_block(complex(m), single, one, theta, out),
        "plain": lambda: plain_mie.by_sphere(complex(m), x, theta, s1, s2),
        "rays": lambda: goa.intensity_block(m, single, one, theta, out, 3, **of.PLAIN),
        "corrected": lambda: goa.intensity_block(m, single, one, theta, out, 3, edge="narrow"),
        "vectorised, 64": lambda: mie.intensity_block(complex(m), many, weight, theta, out),
        "corrected, 64": lambda: goa.intensity_block(m, many, weight, theta, out, 3, edge="narrow"),
    }
    slow = {"plain, angle by angle": lambda: plain_mie.by_angle(complex(m), x, theta[:: 10 if x > 300 else 1], s1, s2)}
    taken = in_turn(jobs | slow, 7 if x < 5000 else 5)
    if x > 300:
        taken["plain, angle by angle"] *= ANGLES / len(theta[::10])
    return {name: value / (TOGETHER if "64" in name else 1) for name, value in taken.items()}


def crossing(radii, ratios):
    """Radius from which the series takes longer (ratio above 1)."""
    return of.first_below(np.asarray(radii), 1 / np.asarray(ratios), 1.0)


def start(radius):
    return f"≤ {RADII[0]:g}" if radius == RADII[0] else of.short(radius)


def measure():
    times = {radius: seconds(radius) for radius in TIMED}  # alone, before other work
    ratios = {name: [times[r][a] / times[r][b] for r in TIMED] for name, (a, b) in PAIRS.items()}
    cells = [(name, averaged) for name in of.INDICES for averaged in (False, True)]
    radii = (*RADII, SWITCH)
    flat = of.together(pattern_errors, [(of.INDICES[name], radius, averaged) for name, averaged in cells for radius in radii])
    rows = {cell: flat[i * len(radii):(i + 1) * len(radii)] for i, cell in enumerate(cells)}
    errors = {(name, variant, averaged): np.array([row[variant] for row in rows[name, averaged][:-1]])
              for name, averaged in cells for variant in of.VARIANTS}
    squares = {name: np.array(of.together(relative_squares, [(m, radius) for radius in FINE])) for name, m in of.INDICES.items()}
    shown = [(variant, averaged) for variant in ("as printed", "+ edge", "+ wide edge") for averaged in (False, True)]
    at_switch = {name: (relative_squares(m, SWITCH), *(rows[name, averaged][-1][variant] for variant, averaged in shown))
                 for name, m in of.INDICES.items()}
    return dict(ratios=ratios, errors=errors, squares=squares, at_switch=at_switch)


def tables(numbers):
    switch = of.table([f"at {SWITCH:g} µm", "RelMSE: pointwise / global", "one sphere, as printed: rms log10 / L1", "log-normal",
                       "one sphere, narrow edge", "log-normal", "one sphere, wide edge", "log-normal"],
                      [[name, *(f"{of.short(a)} / {of.short(b)}" for a, b in numbers["at_switch"][name])] for name in of.SHOWN])
    body = []
    for name in of.SHOWN:
        for variant in of.VARIANTS:
            error = numbers["errors"][name, variant, True][:, 1]
            body.append([name, variant, of.short(float(error[-1])),
                         *(start(of.first_below(RADII, error, limit)) for limit in LIMITS)])
    limits = of.table(["", "", "L1 at 1000 µm", *(f"L1 below {100 * limit:g} % from, µm" for limit in LIMITS)], body)
    squares = of.table(["RelMSE below 0.01 from, µm", *of.INDICES],
                       [[how, *(of.short(of.first_below(FINE, numbers["squares"][name][:, i], 0.01)) for name in of.INDICES)]
                        for i, how in enumerate(("mean of the relative squares", "global ratio"))])
    rows = []
    for name, row in numbers["ratios"].items():
        slope = np.polyfit(np.log(TIMED[-4:]), np.log(row[-4:]), 1)[0]
        rows.append([name, *(of.short(v) for v in row), of.short(crossing(TIMED, row)), f"{slope:.2f}"])
    times = of.table(["time of the series over the rays", *(f"{r:g} µm" for r in TIMED), "crossing, µm", "grows as r to the"],
                     rows)
    return {"fig6-switch": switch, "fig6-limits": limits, "fig6-relmse": squares, "fig6-times": times}


def draw(numbers):
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(2, 2, figsize=(9.6, 7.2))
    panel = axes[0, 0]
    for name in of.INDICES:
        for i, style in ((0, "-"), (1, "--")):
            panel.loglog(FINE, numbers["squares"][name][:, i], style, color=of.OF_INDEX[name],
                         label=f"{name}, {'mean' if i == 0 else 'global'}", lw=1.2)
    panel.axhline(0.01, color="#5d6875", lw=0.8)
    panel.set(title="The paper's metric, as printed, one sphere", ylabel="RelMSE of (|S1| + |S2|)/2", ylim=(2e-6, 2e3))
    panel.legend(fontsize=7, ncol=2, loc="upper right", columnspacing=1, handlelength=1.6)
    for panel, averaged in ((axes[0, 1], False), (axes[1, 0], True)):
        for variant in of.VARIANTS:
            panel.loglog(RADII, numbers["errors"]["water", variant, averaged][:, 1], color=of.COLOURS[variant], label=variant)
        panel.axhline(0.01, color="#5d6875", lw=0.8)
        panel.set(title=f"Water, {'log-normal, sigma 1.3' if averaged else 'one sphere'}", ylabel="L1 of the phase function",
                  ylim=(5e-4, 0.6))
        panel.legend(fontsize=8)
    panel = axes[1, 1]
    colour = dict(zip(PAIRS, ("#b23a6f", "#c2410c", "#c99a06", "#2b8a4b", "#7b4fb5")))
    label = {"angle by angle / rays": "plain series, angle by angle / rays", "plain / rays": "plain series / rays",
             "vectorised / rays": "vectorised series / rays", "vectorised / corrected": "vectorised series / corrected",
             "vectorised / corrected, 64 sizes": "the same, average of 64 sizes"}
    for name, row in numbers["ratios"].items():
        panel.loglog(TIMED, row, "o-", ms=3, color=colour[name], label=label[name], lw=1.2)
    panel.axhline(1, color=of.INK, lw=0.8)
    panel.set(title="Time of Lorenz-Mie over time of rays", ylabel="ratio of times, 1801 angles", ylim=(0.01, 3e5))
    panel.legend(fontsize=7.5)
    for panel in axes.flat:
        panel.set_xlabel("radius, µm")
        panel.axvline(SWITCH, color="#5d6875", lw=0.8, ls=":")
        panel.set_xticks([1, 2, 10, 100, 1000], ["1", "2", "10", "100", "1000"])
    return figure
