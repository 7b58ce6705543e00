"""Amounts of particles by number, volume and mass, and the histograms of instruments, as recipes state them."""

import math

import numpy as np
import pytest

import bakery
from bakery.errors import RecipeError
from bakery.physics.sizes import population
from bakery.recipe import load
from bakery.stages.optics.amounts import amounts
from bakery.stages.optics.size_keys import sizes
from bakery.stages.optics.spheres import dry

COMPONENTS = "  components:\n"
HEAD = "bakery: 1\nname: air\nwavelengths: [0.55]\ntolerance: 10%\n"
# Hess, Koepke & Schult, Bull. Am. Meteorol. Soc. 79, 831 (1998), table 1c: sigma, radius in um, density in g/cm^3, and the mass
# in ug/m^3 of one particle a cm^3, up to a radius of 7.5 um
OPAC = {"WASO": (2.24, 0.0212, 1.8, 1.34e-3), "SOOT": (2.00, 0.0118, 1.0, 5.99e-5), "SUSO": (2.03, 0.0695, 1.7, 2.28e-2),
        "MINM": (1.95, 0.07, 2.6, 2.78e-2), "MIAM": (2.00, 0.39, 2.6, 5.53), "INSO": (2.51, 0.471, 2.0, 23.7)}


@pytest.fixture
def write(tmp_path):
    def write(particles, **tables):
        for name, table in tables.items():
            (tmp_path / f"{name}.csv").write_text(table)
        path = tmp_path / "air.yaml"
        path.write_text(f"{HEAD}particles:\n{particles}")
        return path

    return write


def component(name, keys, size="{distribution: single, radius: 0.1 um}"):
    return f"    - {{name: {name}, material: {{n: 1.5}}, {keys}, size: {size}}}\n"


def counted(recipe):
    return amounts(recipe.particles, *dry(recipe.particles))


@pytest.mark.parametrize("name", OPAC)
def test_mass_concentrations_are_those_of_opac(write, name):
    sigma, radius, density, mass = OPAC[name]
    size = f"{{distribution: lognormal, radius: {radius} um, sigma: {sigma}, max: 7.5 um}}"
    particles = f"  mass_concentration: {mass} ug/m^3\n{COMPONENTS}" + component("a", f"density: {density} g/cm^3", size)
    recipe = load(write(particles))
    number, fraction = counted(recipe)
    assert fraction == [1.0]
    assert number == pytest.approx(1e6, rel=6e-3)  # three digits of the table


def test_all_ways_to_say_it_are_one(write):
    """Radius 0.1 um, density 2 g/cm^3: 1e9 particles a cubic metre are 4.19e-12 of the volume and 8.38 ug/m^3."""
    volume = 4 / 3 * math.pi * 1e-21 * 1e9
    for amount in ("number_density: 1000 /cm^3", f"volume_fraction: {volume!r}",
                   f"volume_concentration: {volume * 1e12!r} um^3/cm^3", f"mass_concentration: {volume * 2e15!r} ng/m^3"):
        of_all = load(write(f"  {amount}\n{COMPONENTS}" + component("a", "density: 2 g/cm^3")))
        of_each = load(write(COMPONENTS + component("a", f"density: 2 g/cm^3, {amount}")))
        for recipe in (of_all, of_each):
            number, fraction = counted(recipe)
            assert number == pytest.approx(1e9, rel=1e-12) and fraction == [1.0]


def test_components_with_amounts_of_their_own(write):
    recipe = load(write(COMPONENTS + component("a", "number_density: 3e8 /m^3")
                        + component("b", "volume_concentration: 4 um^3/cm^3", "{distribution: single, radius: 1 um}")))
    number, fraction = counted(recipe)
    b = 4e-12 / (4 / 3 * math.pi * 1e-18)
    assert number == pytest.approx(3e8 + b, rel=1e-13)
    assert fraction == pytest.approx([3e8 / (3e8 + b), b / (3e8 + b)], rel=1e-13)


def test_a_bake_of_masses_is_that_of_numbers(write, tmp_path):
    recipe = load(write(COMPONENTS + component("a", "mass_concentration: 20 ug/m^3, density: 1.5 g/cm^3")
                        + component("b", "mass_concentration: 5 ug/m^3, density: 2 g/cm^3")))
    number, (a, b) = counted(recipe)
    by_mass = bakery.open(bakery.bake(recipe.path, tmp_path / "mass.h5")).medium
    path = write(f"  number_density: {number!r} /m^3\n{COMPONENTS}" + component("a", f"fraction: {a!r}")
                 + component("b", f"fraction: {b!r}"))
    by_number = bakery.open(bakery.bake(path, tmp_path / "number.h5")).medium
    assert np.allclose(by_mass.sigma_t, by_number.sigma_t, rtol=1e-13, atol=0)


NUMBER, MASS = "  number_density: 1 /m^3\n", "  mass_concentration: 1 ug/m^3\n"


@pytest.mark.parametrize("particles, message", [
    (COMPONENTS + component("a", "density: 1 g/cm^3"), "particles: found no amount of particles; expected number_density, "),
    (MASS + COMPONENTS + component("a", "fraction: 1"), r"\[0\]: found no density, which mass_concentration needs"),
    ("  mass_concentration: 1 /m^3\n" + COMPONENTS + component("a", "density: 1 g/cm^3"),
     r'"/m\^3" is no unit of mass concentration'),
    ("  mass_concentration: 1\n" + COMPONENTS + component("a", "density: 1 g/cm^3"), r"has no unit; .* \(1 ug/m\^3\?\)"),
    (NUMBER + COMPONENTS + component("a", "density: 1"), r"has no unit; densities take .* \(1 g/cm\^3\?\)"),
    (NUMBER + COMPONENTS + component("a", "density: 1 ug/m^3"), "a density at least 1"),
    (NUMBER + MASS + COMPONENTS + component("a", "density: 1 g/cm^3"), "found mass_concentration beside number_density"),
    (NUMBER + COMPONENTS + component("a", "number_density: 1 /m^3"),
     "found number_density of a component beside number_density of all"),
    (COMPONENTS + component("a", "number_density: 1 /m^3") + component("b", "density: 1 g/cm^3"), r"\[1\]: found no amount"),
    (COMPONENTS + component("a", "number_density: 1 /m^3, fraction: 1"), "found a fraction beside number_density"),
    ("  volume_concentration: 12 um^3/m^3\n" + COMPONENTS + component("a", "fraction: 1"), "is no unit of volume concentration"),
])
def test_wrong_amounts_are_refused(write, particles, message):
    with pytest.raises(RecipeError, match=r"air.yaml:\d+: .*" + message):
        load(write(particles))


@pytest.mark.parametrize("size, message", [
    ("{distribution: lognormal, sigma: 1.5}", "size.radius: missing; expected radius: geometric mean .*; or effective_radius"),
    ("{distribution: lognormal, radius: 1 um, effective_radius: 1 um, sigma: 1.5}", "found effective_radius beside radius"),
    ("{distribution: lognormal, radius: 1 um, sigma: 1.5, effective_variance: 0.1}", "found effective_variance beside sigma"),
    ("{distribution: lognormal, radius: 1 um, effective_variance: 300}", "at most 199"),
    ("{distribution: lognormal, effective_radius: 1 m, sigma: 1.5}", "effective radius of 1e[+]06 um, size parameter"),
    ("{distribution: lognormal, effective_radius: 5 mm, effective_variance: 9}", "or a smaller effective_variance would do"),
    ("{distribution: gamma, variance: 0.1}", "missing; expected radius"),
    ("{distribution: junge, exponent: 3, min: 1 um}", "size.max: missing"),
    ("{distribution: junge, exponent: 3, min: 1 um, max: 0.5 um}", "not above min"),
    ("{distribution: junge, exponent: 30, min: 1 um, max: 5 um}", "at most 20"),
    ("{distribution: histogram}", "missing; expected file"),
])
def test_wrong_sizes_are_refused(write, size, message):
    with pytest.raises(RecipeError, match=r"air.yaml:\d+: .*" + message):
        load(write("  number_density: 1 /m^3\n" + COMPONENTS + component("a", "fraction: 1", size)))


BINS = "  number_density: 1e8 /m^3\n" + COMPONENTS + component("a", "fraction: 1", "{distribution: histogram, file: bins.csv}")


@pytest.mark.parametrize("table", [
    "radius_lower_um,radius_upper_um,dN\n0.1,0.2,3\n0.2,0.4,5\n",
    "diameter_lower_nm,diameter_upper_nm,dN/dlogDp\n200,400,3\n400,800,5\n",
    "# from a counter\n\ndiameter_lower_um, diameter_upper_um, dN/dr\n0.2,0.4,6\n0.4,0.8,5\n",
    "radius_um,dN/dlnr\n0.14142135623730951,3\n0.28284271247461903,5\n"])
def test_histograms_say_the_same_in_many_ways(write, table):
    law, = (part.law for part in population(sizes(load(write(BINS, bins=table)).particles.components[0].size)).parts)
    assert law.edge == pytest.approx((0.1, 0.2, 0.4), rel=1e-12)
    assert law.moment(0, 0.2) == pytest.approx(5 / 8, rel=1e-12)


def test_a_gap_is_an_empty_bin_and_volumes_are_numbers_over_the_cube(write):
    table = "radius_lower_um,radius_upper_um,dV\n0.1,0.2,1\n0.4,0.8,64\n0.8001,1.6,0\n"
    law, = (part.law for part in population(sizes(load(write(BINS, bins=table)).particles.components[0].size)).parts)
    assert law.edge == pytest.approx((0.1, 0.2, 0.4, 0.8, 1.6)) and law.amount == (1, 0, 64, 0) and law.reach() == (0.1, 0.8)
    assert law.moment(0, 0.4) == pytest.approx(0.5, rel=1e-12)  # 64 times the volume, spheres of 64 times the volume


@pytest.mark.parametrize("table, message", [
    ("0.1,0.2,3\n0.2,0.4,5\n", r"bins.csv:1: .*expected a first line with the names"),
    ("radius,dN\n0.1,3\n0.2,5\n", "bins.csv:1: .*expected a first line"),
    ("radius_um,count\n0.1,3\n0.2,5\n", "bins.csv:1: .*expected a first line"),
    ("radius_lower_um,diameter_upper_um,dN\n0.1,0.4,3\n0.2,0.8,5\n", "bins.csv:1: .*expected a first line"),
    ("radius_um,dN\n0.2,3\n0.1,5\n", "bins.csv:3: .*ascending order"),
    ("radius_lower_um,radius_upper_um,dN\n0.2,0.1,3\n0.3,0.4,5\n", 'bins.csv:2: .*found a bin from "0.2" to "0.1"'),
    ("radius_lower_um,radius_upper_um,dN\n0.1,0.3,3\n0.2,0.4,5\n", "bins.csv:3: .*bins that do not overlap"),
    ("radius_um,dN\n0.1,0\n0.2,0\n", "bins.csv: .*all empty"),
    ("radius_um,dN\n0.1,-1\n0.2,5\n", "bins.csv:2: .*at least 0"),
    ("radius_um,dN\n0,1\n0.2,5\n", "bins.csv:2: .*a value above 0"),
    ("radius_um,dN\n0.1,1\n", "bins.csv: .*found 1 row"),
    ("", "bins.csv: .*no line of names"),
    ("radius_um,dN\n" + "".join(f"{i},1\n" for i in range(1, 5000)), "4,999 bins"),
])
def test_wrong_histograms_are_refused(write, table, message):
    with pytest.raises(RecipeError, match=message):
        load(write(BINS, bins=table))


@pytest.mark.parametrize("size", ["{distribution: junge, exponent: 3, min: 0.05 um, max: 5 um}",
                                  "{distribution: histogram, file: bins.csv}"])
def test_baked_means_are_those_of_a_fine_sum(write, tmp_path, size):
    """Cross sections at 40,000 radii, weighted by what scipy says of the law."""
    from scipy import stats

    edge, count = np.array([0.05, 0.1, 0.3, 1.0, 1.5, 5.0]), np.array([1000.0, 400.0, 0.0, 9.0, 2.0])
    rows = "".join(f"{a},{b},{n}\n" for a, b, n in zip(edge, edge[1:], count))
    path = write("  host: vacuum\n  number_density: 1e8 /m^3\n" + COMPONENTS + component("a", "fraction: 1", size),
                 bins="radius_lower_um,radius_upper_um,dN\n" + rows)
    asset = bakery.open(bakery.bake(path, tmp_path / "a.h5", tolerance=0.01))
    s = np.log(0.05) + (np.arange(40_000) + 0.5) / 40_000 * np.log(100)
    r = np.exp(s)
    density = stats.truncpareto(3.0, 100.0, scale=0.05).pdf(r) * r if "junge" in size else \
        stats.rv_histogram((count, np.log(edge)), density=False).pdf(s)
    extinction = bakery.mie.efficiencies(1.5, 2 * np.pi / 0.55 * r)[0] * np.pi * r**2
    mean = np.sum(extinction * density) / np.sum(density)
    assert float(asset.optics["a"].mean_extinction[0]) == pytest.approx(mean, rel=2e-3)
