"""A picture of a phase function and of the lobes that stand for it in production renderers."""

from collections.abc import Mapping

import numpy as np

from bakery.draw.axes import plain_decades
from bakery.draw.picture import Picture
from bakery.draw.style import INK, QUIET
from bakery.physics.medium.phase import phase_at

# name -> what it is called in words; the order is that of tables
LABELS = {
    "hg_g": "HG, exact g", "hg": "HG, best", "draine": "Draine, best", "hg2_moments": "two HG, exact moments 1-3",
    "hg2_g": "two HG, exact g", "hg2": "two HG, best", "hg_draine_g": "HG + Draine, exact g", "hg_draine": "HG + Draine, best",
    "hg_draine_published": "HG + Draine, published", "hg_draine_published_best": "HG + Draine, published, best",
}
_DRAWN = {"hg_g": "#b3541e", "hg2_g": "#8a4fbf", "hg_draine_g": "#1f77a4", "hg_draine_published": "#2f8f5b"}


def lobe_fits(um: float, theta, phase, fits: Mapping) -> Picture:
    """A phase function at one wavelength with some of its fits: values above, ratios below; all angles and the forward peak.

    theta, phase : (A,) rad, 1/sr
    """
    shown = {name: fits[name] for name in _DRAWN if name in fits}
    start = max(np.degrees(theta[1]), 1e-3) if len(theta) > 2 else 0.1
    near = np.union1d(np.geomspace(start, 30, 400), np.degrees(theta[(theta > np.radians(start)) & (theta < np.radians(30))]))
    nodes = np.union1d(np.linspace(0, 180, 721), np.degrees(theta))

    def draw(figure):
        panels = figure.subplots(2, 2, width_ratios=(1.5, 1), height_ratios=(1.7, 1), sharey="row", sharex="col")
        for column, at in enumerate((nodes, near)):
            angle = np.minimum(np.radians(at), np.pi)
            baked = phase_at(theta, phase, angle)
            baked = np.where(baked > 0, baked, np.nan)
            top, bottom = panels[:, column]
            top.plot(at, baked, color=INK, linewidth=2.4, alpha=0.85, label=f"baked, {um:g} µm")
            for name, fit in shown.items():
                values = fit.lobes(angle)
                label = f"{LABELS[name]}: {100 * fit.misfit.misdirected:.2g} % misdirected"
                top.plot(at, values, color=_DRAWN[name], linewidth=1.3, label=label)
                bottom.plot(at, values / baked, color=_DRAWN[name], linewidth=1.3)
            bottom.axhline(1, color=QUIET, linewidth=0.8)
            top.set_yscale("log")
            bottom.set_yscale("log")
        panels[0, 0].set(xlim=(0, 180), ylabel="phase function (1/sr)")
        panels[1, 0].set(xlabel="scattering angle θ (°), 0 = forward", ylabel="fit / baked")
        low, high = panels[1, 0].get_ylim()
        panels[1, 0].set_ylim(min(low, 0.5), max(high, 2))
        plain_decades(panels[1, 0].yaxis)
        panels[1, 0].set_xticks(range(0, 181, 30))
        panels[1, 1].set(xscale="log", xlim=(start, 30), xlabel="θ (°), logarithmic")
        plain_decades(panels[1, 1].xaxis)
        panels[0, 0].set_title("All angles")
        panels[0, 1].set_title("Forward peak")
        panels[0, 0].legend(loc="upper right")

    columns = (("theta [rad]", theta), (f"baked at {um:g} um [1/sr]", phase),
               *((f"{LABELS[name]} [1/sr]", fit.lobes(theta)) for name, fit in shown.items()))
    return Picture("lobes", "Lobes of production renderers", f"The baked phase function at {um:g} um and lobes fitted to it.",
                   (10.4, 6.0), draw, columns)
