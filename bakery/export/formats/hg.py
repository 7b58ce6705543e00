"""Lobes of production renderers, fitted at each wavelength."""

import math

from bakery.errors import RecipeError
from bakery.export.declaration import Exporter, Job, Written, delta_taken_out


def write(job: Job) -> Written:
    from bakery.export.fits import LABELS
    from bakery.export.hg import droplet_diameter, errors, hg_files, lobe_rows, useless
    from bakery.export.medium import scattering_of
    from bakery.system.terminal import table

    asset, stem = job.asset, job.stem
    rows = lobe_rows(asset.tree, asset.name, droplet_diameter(asset.tree) if water_in_air(asset.recipe) else None)
    lines = []
    for row in rows:
        first = next(iter(row.fits.values())).misfit
        lines.append(f"{row.wavelength:g} um: g {row.coefficients['g']:.4f}, {100 * first.peak_table:.3g} % of the light within "
                     f"{math.degrees(first.peak_angle):.3g} deg")
        head = ("  fit", "weight", "g", "alpha", "misdirected", "error of g", "rms log10", "furthest off", "in the peak")
        lines += table([head, *(_fit(LABELS[name], fit) for name, fit in row.fits.items())])
    lines += delta_taken_out(scattering_of(asset.tree["medium"]).delta.max())
    lines += ["misdirected: share of the light that goes to another angle.",
              "rms log10: of the ratio fit / asset, over the sphere and over the angle; !: off by more than a factor of ten.",
              "in the peak: light within the angle where the asset's phase function has fallen to half of its forward value."]
    files = {f"{stem}_{name}": content for name, content in hg_files(asset.tree, asset.name, rows).items()}
    return Written(files, errors(rows), lines, [f"{stem}_lobes: {line}" for line in useless(rows)])


def _fit(label: str, fit) -> tuple[str, ...]:
    from bakery.export.hg import far_off

    lobes, misfit = fit.lobes, fit.misfit
    ratio = f"x {misfit.factor:.3g}" if misfit.factor >= 1 else f"/ {1 / misfit.factor:.3g}"
    return (f"  {label}" + (f" for {fit.diameter:.3g} um" if fit.diameter else ""), _joined(lobes.weight, ".3f"),
            _joined(lobes.g, ".7g"), _joined(lobes.alpha, ".3g") if any(lobes.alpha) else "", f"{100 * misfit.misdirected:.2g} %",
            f"{round(misfit.g, 4) + 0.0:+.4f}", f"{misfit.log_sphere:.3f} {misfit.log_angle:.3f}",
            f"{ratio} at {math.degrees(misfit.factor_at):.3g} deg" + (" !" if far_off(misfit) else ""),
            f"{100 * misfit.peak:.3g} %")


def _joined(values, form: str) -> str:
    return " ".join(f"{value:{form}}" for value in values)


def water_in_air(recipe: str) -> bool:
    """Whether an asset's recipe text is about droplets of water in air: for others the published fit was not made."""
    from bakery.grammar.text import Mapping, Scalar, Sequence, Source, parse

    try:
        node = parse(Source("recipe", recipe)).root
    except RecipeError:
        return False
    particles = node.get("particles") if isinstance(node, Mapping) else None
    components = particles.get("components") if isinstance(particles, Mapping) else None
    if not isinstance(components, Sequence) or not all(isinstance(component, Mapping) for component in components):
        return False
    named = [particles.get("host"), *(component.get("material") for component in components)]
    return len(named) == 2 and [node.text if isinstance(node, Scalar) else "" for node in named] == ["air", "water"]


EXPORTER = Exporter(
    "hg", "one and two Henyey-Greenstein lobes, HG + Draine, with their errors (JSON, CSV)",
    "renderers with one or two lobes, by hand", ("medium",), "coefficients and lobes at each wavelength, with errors",
    "the phase function's shape beyond the lobes", write)
