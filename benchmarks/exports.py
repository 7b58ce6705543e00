"""What each format loses of each shipped recipe: the table of docs/measurements/export.md.

    python -m benchmarks.exports [RECIPE…]           some five minutes; what the cache knows is not baked again

Percent of the scattered light that goes to another angle at the worst wavelength; light that counts as unscattered is left out.
A family stands for itself by its first and its last member.  Recipes of the same numbers share a line.
"""

import argparse
import contextlib
import math
import os
import tempfile
from pathlib import Path

import bakery
from bakery.cli import status_of
from bakery.export.blender import cycles_medium
from bakery.export.medium import medium_of, scattering_of
from bakery.export.mitsuba import fragments
from bakery.export.one_lobe import one_lobe
from bakery.physics.medium.lobe_fits import hg_draine
from bakery.physics.medium.lobes import misfit
from benchmarks.sizes import sized
from renderers.colour import band_matrix

RECIPES = Path(__file__).resolve().parents[1] / "recipes"
WITHIN = math.radians(2)
HEAD = ("recipe", "g", "one lobe: `pbrt`, `materialx`, `usd`", "reduced scattering", "one lobe, unscattered within 2°",
        "that share", "two lobes: `blender`", "two, unscattered within 2°", "two for each wavelength: `hg`", "`mitsuba`",
        "`--each-wavelength`", "its peak")


def baked(recipe: Path, folder: Path):
    """(name, asset) of a recipe's medium; of a family the first and the last member; nothing where there is no medium."""
    output = folder / f"{recipe.stem}.h5"
    with open(os.devnull, "w") as nowhere, contextlib.redirect_stdout(nowhere), contextlib.redirect_stderr(nowhere):
        status_of(["bake", str(recipe), "--stage", "medium", "-o", str(output)])
    if not output.exists():
        return
    found = bakery.open(output)
    if isinstance(found, bakery.Family):
        for member in (found.members[0], found.members[-1]):
            yield f"{recipe.stem} ({member.path.stem.replace('-', '; ').replace('e; ', 'e-')})", bakery.open(member.path)
    elif "medium" in found.stages:
        yield recipe.stem, found


def percent(share: float) -> str:
    return f"{100 * share:.2g}" if share > 1e-6 else "0"


def row(asset) -> tuple[str, ...]:
    """Numbers of the columns."""
    tree, name = asset.tree, asset.name
    one, folded = one_lobe(tree, name), one_lobe(tree, name, WITHIN)
    two, narrow = cycles_medium(tree, name), cycles_medium(tree, name, WITHIN)
    medium = scattering_of(medium_of(tree, name))
    own = max(misfit(medium.theta, phase, hg_draine(medium.theta, phase)).misdirected for phase in medium.phase)
    (colour,) = fragments(tree, name, band_matrix(asset.wavelength))
    each = fragments(tree, name, band_matrix(asset.wavelength), each_wavelength=True)
    of_one = max((loss.misdirected for loss in colour.colour.values()), default=colour.resampling.misdirected)
    largest = max(each, key=lambda part: part.peak)
    reduced = max((loss.reduced for loss in one.losses), key=abs)
    saved = folded.unscattered > 1e-3
    peak = f"{percent(largest.peak)} in {math.degrees(largest.within):.2g}°" if largest.peak else ""
    return (f"{one.g:.3f}", percent(one.misdirected), f"{round(100 * reduced, 1) + 0.0:+g} %" if abs(reduced) > 5e-4 else "0",
            percent(folded.misdirected) if saved else "", percent(folded.unscattered) if saved else "", percent(two.misdirected),
            percent(narrow.misdirected) if saved else "", percent(own), percent((1 - colour.peak) * of_one),
            percent(max((1 - part.peak) * part.resampling.misdirected for part in each)), peak)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recipes", nargs="*", type=Path)
    chosen = parser.parse_args().recipes or sized(sorted(RECIPES.glob("*.yaml")), [RECIPES / "haze.yaml", RECIPES / "milk.yaml"])
    rows: dict[tuple[str, ...], list[str]] = {}
    with tempfile.TemporaryDirectory() as folder:
        for recipe in chosen:
            for name, asset in baked(recipe, Path(folder)):
                rows.setdefault(row(asset), []).append(name)
    print("| " + " | ".join(HEAD) + " |")
    print("|" + "---|" * len(HEAD))
    for numbers, names in rows.items():
        print("| " + " | ".join([", ".join(names).replace("_", " "), *numbers]) + " |")
