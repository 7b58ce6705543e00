"""Optical quantities in one table, moments and expansion coefficients of assets: against miepython, and at extremes."""

import json
import math

import numpy as np
import pytest

import bakery
from bakery.errors import UsageError
from bakery.physics.medium.quantities import effective_sizes
from bakery.stages.optics.composition import components
from bakery.stages.optics.quantities import table
from bakery.store.tree import Dataset, Group, text

# One log-normal population, median radius 0.3 um, sigma 1.5, cut at 0.02 and 4 um, n = 1.45 + 0.005 i, at 0.55 um:
# miepython 3.3.0, efficiencies_mx and S1_S2, summed over 3000 Gauss nodes in ln r
MIEPYTHON = {"single_scattering_albedo": 0.9616924417073212, "asymmetry": 0.7443676762023176, "lidar_ratio": 46.99318063016889,
             "depolarisation_ratio_90": 1.2881584418352214, "mass_extinction_efficiency": 2.943914554017099}
C_EXT, C_SCA, BACK = 1.2558706332134797, 1.2077612957235906, 0.02672452931196639  # um^2, um^2, um^2/sr
# between 0.5 and 0.55 um
EXPONENTS = {"extinction": -0.1296462702734766, "scattering": -0.17735646551918563, "absorption": 1.002083364345364}
RADIUS, VARIANCE = 0.452499770421948, 0.17868715212061925

POPULATION = {"bakery": 1, "name": "drops", "wavelengths": "[0.55, 0.5] um", "tolerance": "1%", "phase": {"polarized": True},
              "particles": {"host": {"n": 1.0}, "number_density": "1e8 /m^3", "components": [
                  {"name": "drops", "material": {"n": 1.45, "k": 0.005},
                   "size": {"distribution": "lognormal", "radius": "0.3 um", "sigma": 1.5, "min": "0.02 um", "max": "4 um"}}]}}


def medium_of(wavelengths=(0.5,), phase=None, sigma_s="1 /m", sigma_a="0 /m"):
    return bakery.bake({"bakery": 1, "name": "gel", "wavelengths": list(wavelengths), "tolerance": "1%", "medium": {
        "sigma_s": sigma_s, "sigma_a": sigma_a, "phase": phase or {"type": "hg", "g": 0.8}}})


@pytest.fixture(scope="module")
def drops():
    return bakery.bake(POPULATION)


def test_quantities_are_those_of_miepython(drops):
    """Within the stated errors, which are the bake's (1 %); the sums above are good to nine digits."""
    shown = drops.optics.table(length="2 km", density="1.8 g/cm^3")
    for name, expected in MIEPYTHON.items():
        figure = shown[name]
        assert abs(figure.values[0] - expected) <= figure.error[0] + 1e-6 * abs(expected), name
        assert figure.error[0] < 0.05 * expected, name
    for name, mean in (("extinction", C_EXT), ("scattering", C_SCA), ("absorption", C_EXT - C_SCA)):
        assert shown[name].values[0] == pytest.approx(1e-4 * mean, rel=1e-3), name
    assert shown["backscatter"].values[0] == pytest.approx(1e-4 * BACK, rel=1e-2)
    assert shown["optical_depth"].values[0] == pytest.approx(2000 * 1e-4 * C_EXT, rel=1e-3)
    assert shown["transmittance"].values[0] == pytest.approx(math.exp(-0.2 * C_EXT), rel=1e-3)
    assert shown["visibility"].values[0] == pytest.approx(math.log(50) / (1e-4 * C_EXT), rel=1e-3)
    assert shown["meteorological_range"].values[0] == pytest.approx(math.log(20) / (1e-4 * C_EXT), rel=1e-3)
    for name, expected in EXPONENTS.items():
        exponent = shown[f"angstrom_exponent_{name}"]
        assert abs(exponent.values[0] - expected) <= exponent.error[0] and exponent.values[0] == pytest.approx(expected, abs=0.02)
    for name, expected in (("effective_radius", RADIUS), ("effective_variance", VARIANCE)):
        assert abs(shown[name].values[0] - expected) <= shown[name].error[0] + 1e-12 and shown[name].error[0] < 0.01 * expected
    assert shown["depolarisation_ratio"].values.tolist() == [0, 0]  # spheres


def test_mixtures_count_by_number(drops):
    """Of two components that are one population in two halves, all figures are those of the whole."""
    half = POPULATION["particles"]["components"][0]
    both = bakery.bake(POPULATION | {"particles": {"host": {"n": 1.0}, "number_density": "1e8 /m^3", "components": [
        half | {"name": "a", "fraction": "25%"}, half | {"name": "b", "fraction": "75%"}]}})
    whole, mixed = (asset.optics.table(density=1800.0) for asset in (drops, both))
    for name in ("effective_radius", "effective_variance", "mass_extinction_efficiency", "lidar_ratio"):
        assert mixed[name].values == pytest.approx(whole[name].values, rel=2e-2), name


def test_densities_of_a_recipe_are_read(drops):
    """The key of the recipe that states one is that of particles by mass; a text of an asset may hold it already."""
    recipe = drops.recipe.replace('"name": "drops",\n    "material"', '"name": "drops", "density": "1.8 g/cm^3",\n    "material"')
    assert "density\": \"1.8" in recipe
    stated = Group(drops.tree.members | {"recipe": text(recipe, "the recipe's text")}, drops.tree.attributes)
    assert table(stated)["mass_extinction_efficiency"].values == pytest.approx(
        drops.optics.table(density=1800.0)["mass_extinction_efficiency"].values, rel=1e-12)


def test_amounts_of_each_component_are_read():
    """Number, volume and mass of components give shares by number; what is coated has no density of its material alone."""
    def fractions(first, second):
        recipe = {"particles": {"components": [{"name": "a", **first}, {"name": "b", **second}]}}
        groups = {name: Group({"radius": Dataset(np.array([radius]), "um", ""), "weight": Dataset(np.ones(1), "1", ""),
                               "mean_extinction": Dataset(np.ones(1), "um^2", "")}) for name, radius in (("a", 1.0), ("b", 2.0))}
        root = Group({"recipe": text(json.dumps(recipe), "the recipe's text")})
        return [part["fraction"] for part in components(root, Group(groups))[0]]

    volume = 4 / 3 * math.pi
    half = {"volume_concentration": f"{volume!r} um^3/cm^3"}  # one of a in a cubic centimetre
    assert fractions({"fraction": 0.25}, {"fraction": "75%"}) == [0.25, 0.75]
    assert fractions({"number_density": "1 /cm^3"}, {"number_density": "3e6 /m^3"}) == pytest.approx([0.25, 0.75])
    assert fractions(half, {"number_density": "1 /cm^3"}) == pytest.approx([0.5, 0.5])
    mass = {"mass_concentration": f"{2e6 * 8e-18 * volume * 1e9 * 1000!r} ug/m^3", "density": "1 g/cm^3"}  # two of b
    assert fractions(half, mass) == pytest.approx([1 / 3, 2 / 3])
    assert fractions(half, mass | {"coating": {}}) == [] and fractions(half, {}) == []


def test_rayleigh_has_the_lidar_ratio_of_theory():
    """8 pi / 3 sr; the phase function 3 / (16 pi) (1 + cos^2) is interpolated to the tolerance."""
    shown = medium_of((0.4, 0.8), {"type": "rayleigh"}, "[16, 1] /m").medium.table()
    assert shown["lidar_ratio"].values == pytest.approx(8 * math.pi / 3, rel=1e-3)
    assert shown["angstrom_exponent_scattering"].values == pytest.approx([4.0], rel=1e-12)
    assert (shown["extinction"].error == 0).all()  # as the recipe gives it


def test_what_an_asset_cannot_say_it_says():
    shown = medium_of().medium.table()
    missing = {figure.name: figure.missing for figure in shown.figures if figure.values is None}
    assert missing["angstrom_exponent_extinction"] == "needs two different wavelengths"
    assert "needs particles" in missing["effective_radius"] and "s22" in missing["depolarisation_ratio"]
    assert "phase: {polarized: true}" in missing["depolarisation_ratio_90"] and "length=100m" in missing["optical_depth"]
    text = repr(shown)
    assert "# effective_radius, effective_variance, mass_extinction_efficiency: needs particles" in text and "nan" not in text


@pytest.mark.parametrize("sigma_s, sigma_a, albedo", [("0 /m", "2 /m", 0.0), ("2 /m", "0 /m", 1.0), (None, None, 0.0)])
def test_extremes_of_albedo(sigma_s, sigma_a, albedo):
    nothing, dark = sigma_s is None, sigma_s != "2 /m"
    asset = medium_of((0.5, 0.6), sigma_s=sigma_s or "0 /m", sigma_a=sigma_a or "2 /m")
    if nothing:  # no recipe says this, a file may
        for name in ("sigma_t", "sigma_a"):
            asset.tree["medium"].members[name] = Dataset(np.zeros(2), "1/m", name)
    shown = asset.query("optics")
    assert shown["single_scattering_albedo"].values.tolist() == [albedo, albedo]
    assert np.isnan(shown["visibility"].values).all() == nothing and bool(shown["visibility"].missing) == nothing
    assert np.isnan(shown["lidar_ratio"].values).all() == dark and bool(shown["lidar_ratio"].missing) == dark
    assert "nan" not in repr(shown) and "nan" not in shown._repr_html_() and "NaN" not in json.dumps(shown.as_dict())


def test_no_back_scatter_at_all():
    """A phase function that is 0 straight back has no lidar ratio, and nothing is divided by 0."""
    asset = medium_of()
    phase = asset.tree["medium/phase"].data.copy()
    phase[:, -1] = 0.0
    asset.tree["medium"].members["phase"] = Dataset(phase, "1/sr", "phase function")
    shown = table(asset.tree)
    assert shown["backscatter"].values[0] == 0 and np.isnan(shown["lidar_ratio"].values[0])
    assert shown["lidar_ratio"].missing == "nothing is scattered back"


@pytest.mark.parametrize("arguments, told", [
    ({"length": "5"}, "which has no unit"), ({"length": "5 kg"}, "no unit of length"), ({"length": -1.0}, "found -1 m"),
    ({"density": "0 g/cm^3"}, "found 0 kg/m"), ({"theta": 0.1}, "theta has no effect on it"),
    ({"length": [1.0, 2.0]}, "length is a list"), ({"wavelength": 0.7}, "the asset holds 0.55, 0.5 um")])
def test_wrong_questions(drops, arguments, told):
    with pytest.raises(UsageError, match=told):
        drops.query("optics", **arguments)


def test_between_the_baked_wavelengths():
    asset = medium_of((0.4, 0.5, 0.8), {"type": "rayleigh"}, "[16, 6.5536, 1] /m")
    between = asset.medium.table(wavelength="[600, 500] nm")
    assert between["scattering"].values == pytest.approx([0.6**-4 * 0.8**4, 6.5536], rel=1e-12)
    assert asset.medium.at(0.6).table()["scattering"].values == between["scattering"].values[0]


def test_effective_sizes_of_a_gamma_distribution_are_its_parameters():
    """Hansen and Travis: a and b of r^((1-3b)/b) exp(-r/(ab)) are effective radius and variance."""
    a, b = 10.0, 0.1
    u = np.linspace(-6, 3, 2001)
    r = a * np.exp(u)
    (radius, variance), errors = effective_sizes(r, r ** ((1 - 3 * b) / b + 1) * np.exp(-r / (a * b)))
    assert (radius, variance) == (pytest.approx(a, rel=1e-10), pytest.approx(b, rel=1e-10)) and errors.max() < 1e-9
    assert effective_sizes([2.0], [1.0]) == (pytest.approx([2.0, 0.0]), pytest.approx([0.0, 0.0]))


# ---- moments


def test_moments_of_assets():
    """g^l within the error of the table, which is what the integral of its error allows."""
    asset = medium_of((0.5, 0.6), {"type": "hg", "g": [0.8, 0.3]})
    answer = asset.query("medium/moments", orders=20)
    exact = np.array([0.8, 0.3])[:, None] ** np.arange(21)
    assert answer.values.shape == (2, 21) and (np.abs(answer.values - exact) <= answer.error + 1e-12).all()
    assert (answer.error > 0).all() and answer.error.max() < 1e-2 and answer.axes[1][0] == "order"
    assert answer.values[:, 1] == pytest.approx(asset.medium.g, abs=1e-14)


def test_as_many_moments_as_the_tolerance_needs():
    medium = medium_of().medium
    coarse, fine = medium.moments(), medium.moments(tolerance=1e-4)
    assert coarse.moments.shape < fine.moments.shape and coarse.cut.max() <= 0.01 and fine.cut.max() <= 1e-4
    told = str(medium_of().query("medium/moments").remarks[0].text)
    assert told.startswith(f"orders 0 to {coarse.moments.shape[1] - 1}; the phase function less its series is")


def test_expansions_of_assets(drops):
    """alpha1 is the Legendre moment; the test of van der Mee and Hovenier (1990), which every scattering matrix passes."""
    e, chi = drops.medium.expansion(orders=40), drops.medium.moments(orders=40).moments
    scale = 2 * np.arange(41) + 1
    assert np.abs(e.alpha1 - scale * chi).max() < 1e-12
    assert (np.abs(e.alpha2)[:, 2:] <= scale[2:]).all() and (np.abs(e.alpha4) <= scale).all()
    assert ((scale - e.alpha1) * (scale - e.alpha2) - e.beta1**2 > -1e-3).all()
    answer = drops.query("medium/beta1", orders=40)
    assert np.array_equal(answer.values, e.beta1)
    with pytest.raises(UsageError, match=r"needs the matrix elements s12, s33, s34, which the asset lacks; particles "
                                         r"with phase: \{polarized: true\} would do"):
        medium_of().medium.expansion()


@pytest.mark.parametrize("arguments, told", [({"orders": 3.5}, "whole number"), ({"orders": -1}, "whole number"),
                                             ({"orders": 3, "tolerance": 0.1}, "give one of them"),
                                             ({"tolerance": 0.0}, "above 0"), ({"theta": 0.0}, "has no effect")])
def test_wrong_orders(arguments, told):
    with pytest.raises(UsageError, match=told):
        medium_of().query("medium/moments", **arguments)


# ---- other sources of a medium


@pytest.mark.slow
def test_packed_grains_have_what_their_medium_has():
    from tests.unit.test_labelled import GRAINS

    asset = bakery.bake(GRAINS)
    shown = asset.query("optics", length=0.01)
    assert shown["optical_depth"].values == pytest.approx(0.01 * asset.medium.sigma_t) and shown["lidar_ratio"].values.size == 2
    assert "needs particles" in shown["effective_radius"].missing and "nan" not in repr(shown)
    assert asset.medium.at(0.55).sigma_t == asset.medium.sigma_t[0] and np.isnan(asset.medium.at(0.5).bias["sigma_t"]).all()


@pytest.mark.slow
def test_places_of_families_have_quantities():
    family = bakery.bake({"bakery": 1, "name": "gel", "wavelengths": [0.55, 0.5, 0.45], "tolerance": "5%", "medium": {
        "sigma_s": "1 /mm", "sigma_a": "0.1 /mm", "phase": {"type": "hg", "g": 0.3}}, "sweep": {"medium.phase.g": [0.1, 0.5]}})
    between = family.at(g=0.3)
    assert between.query("optics")["asymmetry"].values == pytest.approx([0.3] * 3, rel=0.05)
    assert between.medium.moments(orders=1).moments[:, 1] == pytest.approx(between.medium.g)
    with pytest.raises(UsageError, match="is a family"):
        family.query("optics")
