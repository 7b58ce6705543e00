"""What a mesh may be filled with, and what its surroundings may be filled with: by the name of a recipe."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bakery.errors import UsageError
from bakery.grammar.fields import nearest
from bakery.recipe import load
from bakery.recipe.starting import Start, starts


@dataclass(frozen=True)
class Filling:
    """How a material fills a mesh."""

    recipe: str | Path  # name of the recipe, as `bake new` knows it; the file of somebody's own
    height: float  # m, of what is usually seen of it; decides the unit of a mesh that says none
    index: float | None = None  # refractive index of a body; None of grains, and of what floats in air
    roughness: float = 0.0  # alpha of the boundary of a body (GGX); 0 is smooth
    floor: tuple[float, float, float] = (0.20, 0.25, 0.31)  # reflectance in red, green and blue of what it stands on


_WARM = (0.34, 0.25, 0.18)
# Indices: milk 1.35 (whole milk at 20 C is 1.347 to 1.352), Jensen et al. 2001 take 1.3 for all of their materials, which these
# recipes keep but where a better one is usual: paraffin 1.446, skin 1.4, marble (calcite, mean) 1.5, soap 1.47, juices and drinks
# in water 1.34.  Roughness is chosen by eye, not measured.
FILLINGS = {
    "milk": Filling("milk", 0.1, 1.35), "whole_milk": Filling("whole_milk", 0.1, 1.35),
    "skim_milk": Filling("skim_milk", 0.1, 1.345), "lowfat_milk": Filling("lowfat_milk", 0.1, 1.345),
    "regular_milk": Filling("regular_milk", 0.1, 1.35), "chocolate_milk": Filling("chocolate_milk", 0.1, 1.35),
    "soy_milk": Filling("soy_milk", 0.1, 1.35), "milk_dilute": Filling("milk_dilute", 0.1, 1.34),
    "cream": Filling("cream", 0.1, 1.36), "espresso": Filling("espresso", 0.06, 1.34),
    "apple_juice": Filling("apple_juice", 0.1, 1.34), "cranberry_juice": Filling("cranberry_juice", 0.1, 1.34),
    "grapefruit_juice": Filling("grapefruit_juice", 0.1, 1.34), "gatorade": Filling("gatorade", 0.1, 1.34),
    "shampoo": Filling("shampoo", 0.1, 1.37), "ketchup": Filling("ketchup", 0.1, 1.35, 0.1),
    "apple": Filling("apple", 0.08, 1.3, 0.2), "potato": Filling("potato", 0.08, 1.3, 0.3),
    "chicken": Filling("chicken", 0.1, 1.3, 0.3), "bleach": Filling("bleach", 0.1, 1.34),
    "bubbly_ice": Filling("bubbly_ice", 0.05, 1.31), "bubbles": Filling("bubbles", 0.1, 1.33),
    "wax": Filling("wax", 0.1, 1.446, 0.1), "soap": Filling("soap", 0.08, 1.47, 0.1),
    "translucent": Filling("translucent", 0.1, 1.446, 0.1),
    "marble": Filling("marble", 0.3, 1.5, 0.2, _WARM), "white_marble": Filling("white_marble", 0.3, 1.5, 0.2, _WARM),
    "skin": Filling("skin", 0.25, 1.4, 0.3), "skin_1": Filling("skin_1", 0.25, 1.4, 0.3),
    "skin_2": Filling("skin_2", 0.25, 1.4, 0.3),
    "sand": Filling("sand", 0.03), "wet_sand": Filling("wet_sand", 0.03), "dyed_sand": Filling("dyed_sand", 0.03),
    "salt": Filling("salt", 0.03, floor=_WARM), "sugar": Filling("white_sugar", 0.03, floor=_WARM),
    "white_sugar": Filling("white_sugar", 0.03, floor=_WARM), "cane_sugar": Filling("cane_sugar", 0.03),
    "flour": Filling("flour", 0.05, floor=_WARM), "snow": Filling("snow", 0.3), "snow_pack": Filling("snow_pack", 0.3),
    "snow_grains": Filling("snow_grains", 0.3), "gravel": Filling("gravel", 0.5), "glass_beads": Filling("glass_beads", 0.03),
    "copper_shot": Filling("copper_shot", 0.03),
}
# what fills air, by the number density of its recipe
ASSUMED = 1.33  # index of what is known by its coefficients: that of water
_AIR = 1.001  # index of a host below which it has no surface
AIRS = ("fog", "haze", "cloud", "smoke", "dust", "street_fog", "thick_fog", "opac_fog", "drizzle", "cirrus", "soot")


def filling(name: str) -> Filling:
    """How a material fills a mesh; UsageError with what may where it does not."""
    if name not in FILLINGS:
        raise _refused("--mesh", name, "fills no mesh", FILLINGS, "--mitsuba SCENE.xml" if name in AIRS else "")
    return FILLINGS[name]


def of_recipe(path: Path) -> Filling:
    """How the material of somebody's own recipe fills a mesh; UsageError where it has none that does."""
    recipe = load(path)
    if recipe.grains is not None and recipe.packing is not None:
        return Filling(path, 0.03)
    if recipe.particles is not None:
        index = float(np.mean(recipe.particles.host.n))
        return Filling(path, 0.1, index if index > _AIR else None)
    if recipe.medium is None:
        raise UsageError(f"{path}: found a recipe without a medium, particles or packed grains, which fills no mesh; "
                         "expected a recipe with a section medium or particles, or with grains and packing")
    return Filling(path, 0.1, ASSUMED)


def air(name: str) -> Start:
    """The recipe of what fills the air of a scene; UsageError with what may where it does not."""
    if name not in AIRS:
        raise _refused("--mitsuba", name, "does not fill the air of a scene", AIRS, "--mesh FILE" if name in FILLINGS else "")
    return starts()[name]


def _refused(option, name, why, accepted, other_option):
    hint = f": {name} takes {other_option}" if other_option else "" if name in starts() else nearest(name, accepted)
    named = ", ".join(list(accepted)[:: max(len(accepted) // 6, 1)])
    file = ", or the file of a recipe" if option == "--mesh" else ""
    return UsageError(f'{option}: found "{name}", which {why}{hint}; expected {named} and others, `bake new --list` names them'
                      f"{file}")
