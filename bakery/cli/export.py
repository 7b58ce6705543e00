"""`bake export ASSET --to FORMAT`: exports an asset to other software and reports the losses."""

from __future__ import annotations

import math
from pathlib import Path

import click

from bakery.cli import offers
from bakery.cli.options import at_option, json_option, one_asset, overwrite_option, print_json, print_paths
from bakery.errors import RecipeError, UsageError
from bakery.system.terminal import remark

FORMATS = {"csv": "every table, units in the headings", "mitsuba": "a medium for stock Mitsuba 3 (XML)",
           "hg": "one and two Henyey-Greenstein lobes, HG + Draine, with their errors (JSON, CSV)",
           "pbrt": "a medium for pbrt-v4", "materialx": "OpenPBR surfaces around the medium (.mtlx)",
           "usd": "the same as USD materials (.usda)",
           "blender": "a script that makes a material for Cycles, HG + Draine (.py)",
           "ply": "grains as meshes, tiles as points with radii", "obj": "grains as meshes",
           "xyz": "tiles as extended XYZ, for particle viewers"}
LOBES = ("pbrt", "materialx", "usd", "blender")  # media of the same lobes at all wavelengths
PEAK = math.radians(2)  # --unscattered-within is tried with it, and
WORTH = 0.05  # of the light: what it must save to be named


@click.command(name="export", short_help="hand an asset to other software")
@click.argument("asset", type=click.Path(), metavar="ASSET")
@click.option("--to", "target", required=True, metavar="FORMAT", shell_complete=offers.among(FORMATS),
              help="; ".join(f"{name}: {text}" for name, text in FORMATS.items()))
@click.option("-o", "--output", type=click.Path(), metavar="DIR",
              help="Folder of the files.  Default: NAME-FORMAT beside the asset.")
@click.option("--each-wavelength", is_flag=True,
              help="mitsuba: one file a wavelength, instead of one in colour with a mean table.")
@click.option("--unscattered-within", "within", metavar="ANGLE",
              help="pbrt, materialx, usd, blender: count the forward peak within this angle, such as 1deg, as unscattered light.")
@at_option
@overwrite_option
@json_option
def command(asset, target, output, each_wavelength, within, place, overwrite, as_json):
    """Write ASSET for other software.

    Prints the files on standard output; on standard error what was lost on the way, and first what makes a file nearly useless.
    """
    from bakery.draw.files import folder_for
    from bakery.store.outputs import by_suffix, check_outputs
    from bakery.store.put import put

    if target not in FORMATS:
        raise UsageError(f'--to: found "{target}", which is no format of ours; there is ' +
                         " and ".join(f"{name} ({text})" for name, text in FORMATS.items()))
    if each_wavelength and target != "mitsuba":
        raise UsageError(f"--each-wavelength: has no effect on {target}, whose tables hold every wavelength; leave it out")
    if within is not None and target not in LOBES:
        raise UsageError(f"--unscattered-within: has no effect on {target}; it is for {', '.join(LOBES)}")
    angle = _angle(within) if within is not None else 0.0
    opened = one_asset(asset, place)
    stem = Path(opened.path).stem
    first: list[str] = []
    if target == "csv":
        files, losses, lines = _csv(opened)
    elif target == "hg":
        files, losses, lines, first = _hg(opened)
    elif target in LOBES:
        files, losses, lines, first = _lobes(opened, stem, target, angle)
    elif target in ("ply", "obj", "xyz"):
        files, losses, lines = _forms(opened, target)
    else:
        files, losses, lines, first = _mitsuba(opened, stem, each_wavelength)
    if (target in LOBES or target == "mitsuba") and not each_wavelength:
        first += _beyond(opened, next(iter(files)))
    for warning in first:
        remark(f"warning: {warning}")
    folder = folder_for(Path(output) if output else Path(opened.path).with_name(f"{stem}-{target}"))
    check_outputs(by_suffix(folder / name for name in files), [asset], overwrite)
    paths = [str(put(folder / name, content)) for name, content in files.items()]
    if as_json:
        print_json({"files": paths, "warnings": first, "lost": losses})
        return
    _print(paths, lines)


def _beyond(asset, file: str) -> list[str]:
    """What a file in colour has of bands that the asset's wavelengths do not reach."""
    from bakery.export.bands import beyond
    from renderers.colour import BANDS

    return [f"{file}: {line}" for line in beyond(asset.wavelength, dict(zip(("red", "green", "blue"), BANDS, strict=True)))]


def _identity(asset) -> str:
    """What the medium is called in a file: as the asset and its file, as several assets of one recipe stand in one scene."""
    stem = Path(asset.path).stem
    return stem if stem.startswith(asset.name) else f"{asset.name}_{stem}"


def _csv(asset):
    from bakery.export.csv import csv_files

    files = {f"{Path(asset.path).stem}_{name}": text for name, text in csv_files(asset.tree).items()}
    return files, [], ["nothing is lost: every number has all its digits; provenance stays in the asset"]


def _forms(asset, target: str):
    """Meshes of grains and packed spheres: whatever the asset holds of what the format takes."""
    from bakery.export.grains import obj_meshes, ply_meshes
    from bakery.export.tiles import ply_files, xyz_files

    if target == "obj":
        meshes, tiles = obj_meshes(asset.tree), {}
    else:
        meshes = ply_meshes(asset.tree) if target == "ply" else {}
        tiles = {} if meshes and "packing" not in asset.stages else (ply_files if target == "ply" else xyz_files)(asset.tree)
    stem, lines = Path(asset.path).stem, []
    if meshes:
        lines.append("grains keep all their digits, in radii of their bounding sphere; surfaces and figures stay in the asset "
                     "(--to csv)")
    if tiles:
        lines.append("positions and radii keep all their digits; g2, chords and their errors stay in the asset (--to csv)")
    named = {f"{stem}{end}": content for end, content in meshes.items()}
    named |= {f"{stem}{'_tile' if meshes and not end.startswith('_') else ''}{end}": content for end, content in tiles.items()}
    return named, [], lines


def _print(paths, lines) -> None:
    """Paths; on standard error what belongs to each file, where `lines` is a list of such lists, and what belongs to all."""
    print_paths(paths)
    per_file = [line for line in lines if isinstance(line, list)]
    for path, about in zip(paths, per_file):
        remark(path)
        for line in about:
            remark(line)
    for line in lines:
        if not isinstance(line, list):
            remark(line)


def _mitsuba(asset, stem: str, each_wavelength: bool):
    from bakery.export.mitsuba import fragments
    from bakery.system.terminal import table
    from renderers.colour import band_matrix

    parts = fragments(asset.tree, _identity(asset), band_matrix(asset.wavelength), each_wavelength)
    lines: list = []
    for part in parts:
        head = [("  lost against the asset", "mean error", "largest error", "error of g", "forward peak cut")]
        rows = [("  by the regular grid", *_loss(part.resampling))]
        rows += [(f"  by that and one table, at {um:g} um", *_loss(loss)) for um, loss in part.colour.items()]
        lines.append([f"  phase function: {part.values} values over cos theta", *table(head + rows)])
    if any(part.delta for part in parts):
        lines.append(f"unscattered (delta) transmission of grains, up to {100 * max(part.delta for part in parts):.3g} % of what "
                     "they scatter, is taken out of sigma_t and phase function: the same medium.")
    if any(part.peak for part in parts):
        largest = max(parts, key=lambda part: part.peak)
        lines.append(f"forward peak: up to {100 * largest.peak:.3g} % of the scattered light is deflected by less than "
                     f"{math.degrees(largest.within):.3g} deg, which no table of this length resolves; it counts as "
                     "unscattered, and sigma_t is smaller by it.  The errors above are of the rest.")
    lines += ["mean error: |difference| over the sphere; half of it is the share of the light that goes to another angle.",
              "forward peak cut: of the angles where the phase function is above half of its forward value."]
    first = [f"{stem}{part.name}.xml: nearly useless: {part.useless()}" for part in parts if part.useless()]
    return {f"{stem}{part.name}.xml": part.xml for part in parts}, [part.as_dict() for part in parts], lines, first


def _angle(text: str) -> float:
    """`1deg` in rad."""
    from bakery.export.mixture import WIDEST
    from bakery.grammar.units import ANGLE, Wrong, parse

    try:
        value = parse(text, ANGLE)
    except Wrong as wrong:
        raise UsageError(f"--unscattered-within: {wrong.found}; {wrong.expected}") from None
    if not 0 < value <= WIDEST:
        raise UsageError(f'--unscattered-within: found "{text}"; angles above 0 to {math.degrees(WIDEST):g}deg would do')
    return value


def _lobes(asset, stem: str, target: str, within: float):
    """What takes lobes: one of Henyey and Greenstein's in pbrt and OpenPBR (MaterialX, USD), two in Blender."""
    from bakery.export.blender import blender_text, cycles_medium
    from bakery.export.one_lobe import one_lobe
    from bakery.export.openpbr import materialx_text, surfaces, usd_text
    from bakery.export.pbrt import pbrt_text
    from renderers.colour import band_matrix, rgb_order

    fitted, name = cycles_medium if target == "blender" else one_lobe, _identity(asset)
    medium, bands = fitted(asset.tree, asset.name, within), band_matrix(asset.wavelength)
    said = _lobe_lines(medium, None if within or medium.misdirected < WORTH else fitted(asset.tree, asset.name, PEAK))
    if target == "pbrt":
        file, content = f"{stem}.pbrt", pbrt_text(name, medium)
    elif target == "blender":
        file, content = f"{stem}.py", blender_text(name, medium, bands)
    else:
        end, text = {"materialx": ("mtlx", materialx_text), "usd": ("usda", usd_text)}[target]
        file, content = f"{stem}.{end}", text(name, surfaces(medium, bands), medium.remarks())
    if target != "pbrt" and asset.wavelength.size > 1 and rgb_order(asset.wavelength) is None:
        said.append("Coefficients are means over a red, a green and a blue band of the asset's.")
    return {file: content}, medium.as_dicts(), said, [f"{file}: {line}" for line in medium.useless()]


def _lobe_lines(medium, folded) -> list[str]:
    """What lobes lose, as a table and in words; `folded` is the medium without its forward peak, if that was tried."""
    from bakery.export.one_lobe import OneLobe
    from bakery.system.terminal import table

    head = ("  lost against the asset", "misdirected", "error of g", "reduced scattering", "in the peak")
    rows = [(f"  at {um:g} um", f"{100 * loss.misdirected:.2g} %", f"{round(loss.misfit.g, 4) + 0.0:+.4f}",
             f"{100 * loss.reduced:+.2g} %", f"{100 * loss.misfit.peak:.3g} % instead of {100 * loss.misfit.peak_table:.3g} % "
             f"in {math.degrees(loss.misfit.peak_angle):.3g} deg")
            for um, loss in zip(medium.um.tolist(), medium.losses, strict=True)]
    lobes = " + ".join(f"{weight:.3f} of {'Draine' if alpha else 'Henyey-Greenstein'} with g {g:.4f}"
                       + (f" and alpha {alpha:.3g}" if alpha else "")
                       for weight, g, alpha in zip(medium.lobes.weight, medium.lobes.g, medium.lobes.alpha, strict=True))
    one = len(medium.lobes.g) == 1 and not any(medium.lobes.alpha)
    said = [f"phase function: one Henyey-Greenstein lobe for all wavelengths, g {medium.lobes.g[0]:.4f}" if one else
            f"phase function for all wavelengths: {lobes}", *table([head, *rows])]
    if isinstance(medium, OneLobe):
        least = max(loss.misdirected for loss in medium.best_losses)
        if least < medium.misdirected - 0.005:
            off = max((1 + loss.reduced for loss in medium.best_losses), key=lambda ratio: abs(math.log(ratio)))
            said.append(f"g {medium.best:.4f} would misdirect {100 * least:.2g} %, but multiply the reduced scattering by "
                        f"{off:.2g}: only for media that scatter once.")
    if medium.delta:
        said.append(f"unscattered (delta) transmission of grains, up to {100 * medium.delta:.3g} % of what they scatter, is "
                    "taken out of sigma_s and phase function: the same medium.")
    if medium.within:
        said.append(f"forward peak: up to {100 * medium.unscattered:.2g} % of the scattered light is deflected by less than "
                    f"{math.degrees(medium.within):.3g} deg and counts as unscattered: sigma_s and sigma_t are smaller by it, "
                    "and what is seen through the medium is brighter and sharper.")
    if folded and folded.misdirected < medium.misdirected - WORTH:
        said.append(f"--unscattered-within {math.degrees(PEAK):g}deg would misdirect {100 * folded.misdirected:.2g} %: up to "
                    f"{100 * folded.unscattered:.2g} % of the scattered light, deflected by less, would count as unscattered "
                    "and be taken out of sigma_s and sigma_t.")
    return [*said, "misdirected: share of the light that goes to another angle.  reduced scattering: (1 - g) sigma_s.",
            "Polarisation, tables of multiple scattering and errors stay in the asset."]


def _loss(loss) -> tuple[str, ...]:
    return (f"{200 * loss.misdirected:.2g} %", f"{100 * loss.largest:.2g} % at {math.degrees(loss.largest_at):.3g} deg",
            f"{loss.g:+.1e}", f"{100 * loss.peak:.2g} % of {math.degrees(loss.peak_angle):.3g} deg")


def _hg(asset):
    from bakery.export import scattering_of
    from bakery.export.fits import LABELS
    from bakery.export.hg import droplet_diameter, errors, hg_files, lobe_rows, useless
    from bakery.system.terminal import table

    rows = lobe_rows(asset.tree, asset.name, droplet_diameter(asset.tree) if _water_in_air(asset.recipe) else None)
    lines = []
    for row in rows:
        first = next(iter(row.fits.values())).misfit
        lines.append(f"{row.wavelength:g} um: g {row.coefficients['g']:.4f}, {100 * first.peak_table:.3g} % of the light within "
                     f"{math.degrees(first.peak_angle):.3g} deg")
        head = ("  fit", "weight", "g", "alpha", "misdirected", "error of g", "rms log10", "furthest off", "in the peak")
        lines += table([head, *(_fit(LABELS[name], fit) for name, fit in row.fits.items())])
    if (delta := float(scattering_of(asset.tree["medium"]).delta.max())) > 0:
        lines.append(f"unscattered (delta) transmission of grains, up to {100 * delta:.3g} % of what they scatter, is taken "
                     "out of coefficients and phase function: the same medium.")
    lines += ["misdirected: share of the light that goes to another angle.",
              "rms log10: of the ratio fit / asset, over the sphere and over the angle; !: off by more than a factor of ten.",
              "in the peak: light within the angle where the asset's phase function has fallen to half of its forward value."]
    stem = Path(asset.path).stem
    files = {f"{stem}_{name}": content for name, content in hg_files(asset.tree, asset.name, rows).items()}
    return files, errors(rows), lines, [f"{stem}_lobes: {line}" for line in useless(rows)]


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


def _water_in_air(recipe: str) -> bool:
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
