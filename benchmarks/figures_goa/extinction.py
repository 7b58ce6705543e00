"""Fig. 3: the ripple of extinction in closed form."""

import numpy as np

from bakery import goa, mie
from benchmarks.sizes import sized

from . import measures as of
from . import printed

FORMS = {"eq. 14 as printed": printed.extinction, "sign corrected": lambda m, x: printed.extinction_of_orders(m, x, 1),
         "+ edge": goa.extinction, "4 Re S(0)/x², wide edge": lambda m, x: goa.extinction(m, x, edge="wide", orders=6)}
COLOUR = dict(zip(FORMS, ("#c2410c", "#c99a06", "#2b8a4b", "#7b4fb5")))
X = (10.0, 21.0, 100.0, 1000.0, 1e4)
ALONG = np.geomspace(5.0, 2e4, sized(19, 3))


def error(form, m, x):
    """rms relative error within 10 % of x."""
    sizes = x * np.linspace(0.9, 1.1, 101)
    return float(np.sqrt(np.mean((FORMS[form](m, sizes) / mie.efficiencies(m, sizes)[0] - 1) ** 2)))


def of_itself(m, low=0.5, high=100.0):
    """RelMSE of eq. 12 with p = 1 against p <= 3, radii in um: what the paper's footnote measures."""
    x = of.size_parameter(np.geomspace(low, high, 4000))
    three = printed.extinction_of_orders(m, x, 3)
    return float(np.mean(((three - printed.extinction_of_orders(m, x, 1)) / three) ** 2))


def measure():
    errors = {(name, form): [error(form, m, x) for x in X] for name, m in of.INDICES.items() for form in FORMS}
    curve = {(name, form): [error(form, of.INDICES[name], x) for x in ALONG] for name in ("water", "bubbles") for form in FORMS}
    radius = np.linspace(0.3, 4.0, 500)
    x = of.size_parameter(radius)
    ripple = {name: {"Mie": mie.efficiencies(m, x)[0], **{form: FORMS[form](m, x) for form in list(FORMS)[:3]}}
              for name, m in (("water", 1.33), ("bubbles", 0.75))}
    footnote = of_itself(1.33)
    against = {r: float(error("eq. 14 as printed", 1.33, of.size_parameter(r)) ** 2) for r in (2.0, 10.0, 100.0)}
    return dict(errors=errors, curve=curve, radius=radius, ripple=ripple, footnote=footnote, against=against)


def tables(numbers):
    # the sign is wrong below 1 alone
    body = [[name, form, *(of.short(value) for value in row)] for (name, form), row in numbers["errors"].items()
            if name in of.SHOWN and (form != "sign corrected" or of.INDICES[name] < 1)]
    text = of.table(["", "rms relative error within 10 % of", *(f"x = {x:g}" for x in X)], body)
    against = ", ".join(f"{of.short(value)} at {radius:g} µm" for radius, value in numbers["against"].items())
    return {"fig3": f"{text}\n\nRelMSE, water: p = 1 against p ≤ 3 of the same formula, 0.5 to 100 µm: "
                    f"{of.short(numbers['footnote'])}; p = 1 against Mie: {against}."}


def draw(numbers):
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(2, 2, figsize=(9.2, 5.6))
    for row, (name, m) in zip(axes, (("water", 1.33), ("bubbles", 0.75))):
        row[0].plot(numbers["radius"], numbers["ripple"][name]["Mie"], color=of.INK, label="Lorenz-Mie", lw=2)
        for form in list(FORMS)[:3]:
            row[0].plot(numbers["radius"], numbers["ripple"][name][form], "--" if form == "sign corrected" else "-",
                        color=COLOUR[form], label=form, lw=1.1)
        row[0].set(xlabel="radius, µm", ylabel="extinction / (π r²)", title=f"{name.capitalize()}, index {m}",
                   xlim=(0.3, 4), ylim=(0.5, 4.2))
        for form, curve in ((form, numbers["curve"][name, form]) for form in FORMS):
            row[1].loglog(ALONG, curve, "--" if form == "sign corrected" else "-", color=COLOUR[form], label=form)
        row[1].set(xlabel="size parameter", ylabel="rms relative error", title="Error against Lorenz-Mie", ylim=(3e-6, 1))
    axes[0, 0].legend(fontsize=8)
    axes[1, 1].legend(fontsize=8)
    return figure
