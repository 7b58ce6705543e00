"""Picture of the extinction of packed grains: sigma_t by three ways, and what the walk through the grains met."""

import textwrap
from collections.abc import Iterator

import numpy as np

from bakery.draw.picture import Picture
from bakery.draw.style import NEUTRAL, QUIET, colours
from bakery.stages.grains.pictures import concise, whole
from bakery.stages.medium import pictures as medium_pictures
from bakery.store.tree import Dataset, Group

WAYS = {"mean_flight": "mean flight (Eq. 4)", "second_moment": "second moment", "random_walk": "walk through grains"}


def pictures(root: Group) -> Iterator[Picture]:
    """The extinction of packed grains, where the medium is theirs, then the pictures of any medium."""
    if {"sigma_t", "sigma_t_mean_flight"} <= root["medium"].members.keys():
        yield extinction(root["medium"], root["wavelength"].data)
    yield from medium_pictures.pictures(root)


def extinction(medium: Group, um):
    """sigma_t of packed grains: by the mean flight (Eq. 4), by the second moment, by a walk through explicit grains."""
    ways = {words: _stored(medium, f"sigma_t_{name}") for name, words in WAYS.items() if f"sigma_t_{name}" in medium.members}
    used = medium["sigma_t"].data
    taken = [name for name, (value, _) in ways.items() if np.allclose(value, used, rtol=1e-6)]
    base = "walk through grains" if "walk through grains" in ways else next(iter(ways))
    marks, inks = (dict(zip(WAYS.values(), style, strict=True)) for style in (("o", "s", "D"), NEUTRAL))
    walk = _walk(medium)
    shifts = dict(zip(ways, np.linspace(0.22, -0.22, len(ways)) if len(ways) > 1 else [0.0], strict=True))

    def draw(figure):
        panel, right = figure.subplots(1, 2, sharey=True, width_ratios=(1.15, 1))
        at = -np.arange(len(um), dtype=float)
        for name, (value, error) in ways.items():
            style = {"fmt": marks[name], "color": inks[name], "markersize": 6 if name in taken else 4.6, "capsize": 3,
                     "elinewidth": 1.2, "linestyle": "none"}
            label = name + ("  — taken" if name in taken else "")
            panel.errorbar(1e-3 * value, at + shifts[name], xerr=1e-3 * error, label=label, **style)
            reference, unsure = ways[base]
            ratio = reference / value - 1  # as a length scale
            error = np.where(name == base, unsure / reference, error / value)
            right.errorbar(100 * ratio, at + shifts[name], xerr=100 * error, **style)
        spread = np.concatenate([1e-3 * (value + sign * error) for value, error in ways.values() for sign in (-1, 1)])
        margin = max(0.12 * np.ptp(spread), 0.02 * spread.max())
        panel.set(xlabel="σt (1/mm)", xlim=(spread.min() - margin, spread.max() + margin), ylim=(at[-1] - 0.6, 0.6))
        panel.set_yticks(at, [f"{x:g} µm" for x in um])
        for label, tint in zip(panel.get_yticklabels(), colours(um), strict=True):
            label.set_color(tint)
        right.axvline(0, color=QUIET, linewidth=0.8, linestyle=(0, (4, 3)), zorder=1)
        right.set_xlabel(f"1/σt against the {base} (%)")
        panel.set_title("Extinction coefficient")
        right.set_title("As a length scale")
        for axes in (panel, right):
            axes.grid(axis="y", visible=False)
            axes.tick_params(axis="y", length=0)
        figure.legend(*panel.get_legend_handles_labels(), loc="outside right upper")
        if walk:
            figure.supxlabel("\n".join(textwrap.wrap(walk, 130)), x=0.01, ha="left", fontsize=8.2, color=QUIET)

    sentences = [f"What continuous medium spreads light as the grains do: {len(ways)} answers.  Bars: standard errors."]
    reached = medium.attributes.get("achieved_error")
    if isinstance(reached, float) and "random_walk" in medium.members:
        sentences.append(f"The medium's σt is off by {100 * reached:.2g} % as a length scale.")
    sentences += [walk] if walk else []
    return Picture("extinction", "Extinction of the packed grains", "  ".join(sentences), (9.2, 1.6 + 0.62 * len(um)), draw,
                   (("wavelength [um]", um), *((f"{name}{end} [1/m]", values) for name, pair in ways.items()
                                               for end, values in zip(("", " standard error"), pair, strict=True))))


def _stored(medium: Group, name: str):
    """(value, error) of a coefficient; errors 0 where none are stored."""
    value, error = medium[name].data, medium.members.get(f"{name}_error")
    return value, error.data if isinstance(error, Dataset) else np.zeros_like(value)


def _walk(medium: Group) -> str:
    """What the walk through explicit grains met, beside what the equations say; "" where there was none."""
    walk = medium.members.get("random_walk")
    if not isinstance(walk, Group) or "hits" not in walk.members:
        return ""

    def of(group, name, scale=1.0):
        error = group.members.get(f"{name}_error")
        return concise(scale * float(group[name].data[0]), scale * float(error.data[0]) if isinstance(error, Dataset) else 0.0)

    at = f" at {walk['wavelength'].data[0]:g} µm" if "wavelength" in walk.members else ""
    sentences = [f"Walk through grains{at}, nothing absorbed: {whole(walk['hits'].data[0])} hits"]
    if {"void_chord", "flight"} <= walk.members.keys():
        sentences.append(f"free path between spheres {of(walk, 'void_chord', 1e3)} mm"
                         + (f" (Eq. 1: {of(medium, 'void_chord', 1e3)})" if "void_chord" in medium.members else ""))
        sentences.append(f"between hits {of(walk, 'flight', 1e3)} mm"
                         + (f" (Eq. 3: {of(medium, 'lambda_beta', 1e3)})" if "lambda_beta" in medium.members else ""))
    if "correlation" in walk.members:
        sentences.append(f"correlation of successive flights {of(walk, 'correlation')}")
    return "; ".join(sentences) + "."
