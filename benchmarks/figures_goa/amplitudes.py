"""Fig. 4: |S1| and |S2| against Lorenz-Mie, one sphere and averages."""

import numpy as np

from bakery import goa
from bakery.physics.mie import angular as mie

from . import measures as of
from . import printed

RADII = (0.1, 1.0, 2.0, 10.0, 100.0)
SHOWN = (1.0, 2.0, 10.0, 100.0)
WITHIN = 1.25  # an intensity agrees where it is right to this factor
M = 1.33


def pair(how, x, weight):
    """<|S1|^2>, <|S2|^2> by "Mie" or one of the variants."""
    if how == "as printed":
        return [weight @ abs(s) ** 2 for s in printed.amplitudes(M, x, of.THETA)]
    out = np.empty((4, of.THETA.size))
    if how == "Mie":
        mie.mueller_block(complex(M), x, weight, of.THETA, out)
    else:
        goa.mueller_block(M, x, weight, of.THETA, out, 6, **of.VARIANTS[how][1])
    return out[0] - out[1], out[0] + out[1]


def agreement(how, radius, averaged):
    """rms log10 of |S1|^2, of |S2|^2, and the share of all directions in which their sum is right within a factor WITHIN."""
    sizes = [of.log_normal(radius)] if averaged else [(v, np.ones(1)) for v in (of.size_parameter(radius) * of.SINGLE)[:, None]]
    rows, solid = [], np.sin(of.THETA)
    for x, weight in sizes:
        one, two = pair(how, x, weight)
        e1, e2 = pair("Mie", x, weight)
        good = abs(np.log((one + two) / (e1 + e2))) < np.log(WITHIN)
        rows.append((of.rms_log10(one, e1), of.rms_log10(two, e2), np.sum(solid[good]) / np.sum(solid)))
    return [float(value) for value in np.mean(rows, axis=0)]


def measure():
    cells = [(how, radius, averaged) for radius in RADII for averaged in (False, True) for how in ("as printed", "+ edge")
             if how == "as printed" or radius > 0.5]  # ours starts at x = 1
    curves = {}
    for radius in SHOWN:
        for averaged, spheres in ((False, (of.size_parameter([radius]), np.ones(1))), (True, of.log_normal(radius))):
            curves[radius, averaged] = {how: pair(how, *spheres) for how in ("Mie", "as printed", "+ edge")}
    return dict(cells=dict(zip(cells, of.together(agreement, cells))), curves=curves)


def tables(numbers):
    body = []
    for radius in RADII:
        row = [f"{radius:g}"]
        for averaged in (False, True):
            for how in ("as printed", "+ edge"):
                cell = numbers["cells"].get((how, radius, averaged))
                row.append(f"{of.short(cell[0])} / {of.short(cell[1])} / {100 * cell[2]:.0f} %" if cell else "-")
        body.append(row)
    return {"fig4": of.table(["radius, µm", "one sphere: as printed", "corrected, narrow edge", "log-normal: as printed",
                              "corrected, narrow edge"], body)}


def draw(numbers):
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(len(SHOWN), 2, figsize=(9.2, 9.6), sharex=True)
    degrees = np.rad2deg(of.THETA)
    for (radius, averaged), curves in numbers["curves"].items():
        panel = axes[SHOWN.index(radius), int(averaged)]
        unit = sum(np.sum(part * np.sin(of.THETA)) for part in curves["Mie"])
        for how, width in (("Mie", 2.0), ("as printed", 0.9), ("+ edge", 0.9)):
            label = {"Mie": "Lorenz-Mie", "+ edge": "corrected, narrow edge"}.get(how, how)
            for part, shift in zip(curves[how], (1.0, 1e-3)):
                panel.semilogy(degrees, part / unit * shift, color=of.COLOURS[how], lw=width, label=label if shift == 1 else None)
        panel.set(xlim=(0, 180), title=f"{radius:g} µm, {'log-normal, sigma 1.3' if averaged else 'one sphere'}")
        panel.set_ylim(max(panel.get_ylim()[0], 1e-11), None)
        if not averaged:
            panel.set_ylabel("|S1|², and |S2|²/1000 below")
    for panel in axes[-1]:
        panel.set_xlabel("scattering angle, degrees")
    axes[0, 1].legend(fontsize=8)
    return figure
