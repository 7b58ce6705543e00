"""Coatings, mixtures and growth as recipes state them, and what is baked of them."""

import numpy as np
import pytest

import bakery
from bakery.errors import RecipeError
from bakery.mie import coated_efficiencies, efficiencies
from bakery.recipe import load
from bakery.stages.optics.amounts import amounts
from bakery.stages.optics.spheres import dry
from bakery.stages.optics.stage import STAGE

HEAD = "bakery: 1\nname: air\nwavelengths: [0.55]\ntolerance: 3%\nparticles:\n  host: vacuum\n"
ONE = "{distribution: single, radius: 0.1 um}"
SOOT, SULPHATE = 1.95 + 0.79j, 1.43 + 1e-8j


@pytest.fixture
def write(tmp_path):
    def write(keys, of_all="number_density: 1e9 /m^3", size=ONE, material="{n: 1.95, k: 0.79}", more="", **tables):
        for name, table in tables.items():
            (tmp_path / f"{name}.csv").write_text(table)
        path = tmp_path / "air.yaml"
        text = HEAD + "".join(f"  {line}\n" for line in of_all.split("\n"))
        path.write_text(f"{text}  components:\n    - {{name: a, material: {material}, size: {size}, {keys}}}\n{more}")
        return path

    return write


def component(recipe):
    return STAGE.inputs(recipe, {})["components"][0]


def extinction(path, tmp_path):
    return float(bakery.open(bakery.bake(path, tmp_path / "a.h5", stages=["optics"])).optics["a"].mean_extinction[0])


COAT = "{material: {n: 1.43, k: 1e-8}, "


@pytest.mark.parametrize("coating", ["thickness: 50 nm", "ratio: 1.5", "volume_share: 0.7037037037037037"])
def test_single_spheres_are_those_of_the_series(write, tmp_path, coating):
    k, outer = 2 * np.pi / 0.55, 0.15
    there = coated_efficiencies(SOOT, SULPHATE, k * 0.1, k * outer)[0] * np.pi * outer**2
    assert extinction(write(f"coating: {COAT}{coating}}}"), tmp_path) == pytest.approx(there, rel=1e-12)


@pytest.mark.parametrize("coating", ["thickness: 0 um", "ratio: 1", "volume_share: 0"])
def test_no_coating_is_none(write, tmp_path, coating):
    bare, none = write("fraction: 1"), f"coating: {COAT}{coating}}}"
    there = extinction(bare, tmp_path)
    assert extinction(write(none), tmp_path) == there


def test_a_coating_of_the_cores_material_makes_larger_spheres(write, tmp_path):
    k = 2 * np.pi / 0.55
    there = efficiencies(SOOT, k * 0.15)[0] * np.pi * 0.15**2
    path = write("coating: {material: {n: 1.95, k: 0.79}, ratio: 1.5}")
    assert extinction(path, tmp_path) == pytest.approx(there, rel=1e-13)


@pytest.mark.parametrize("coating", ["thickness: 30 nm", "ratio: 1.4"])
def test_means_over_sizes_are_those_of_a_fine_sum(write, tmp_path, coating):
    from scipy import stats

    size = "{distribution: lognormal, radius: 0.08 um, sigma: 1.5, min: 0.01 um, max: 0.8 um}"
    asset = bakery.open(bakery.bake(write(f"coating: {COAT}{coating}}}", size=size), tmp_path / "a.h5", tolerance=0.003))
    s = np.log(0.01) + (np.arange(20_000) + 0.5) / 20_000 * np.log(80)
    r, weight = np.exp(s), stats.norm(np.log(0.08), np.log(1.5)).pdf(s)
    whole = 1.4 * r if "ratio" in coating else r + 0.03
    k = 2 * np.pi / 0.55
    q_ext, q_sca, q_abs, _, g = coated_efficiencies(SOOT, SULPHATE, k * r, k * whole)
    mean = [np.sum(q * whole**2 * weight) * np.pi / np.sum(weight) for q in (q_ext, q_sca, q_abs, q_sca * g)]
    of = asset.optics["a"]
    for name, value in zip(("mean_extinction", "mean_scattering", "mean_absorption"), mean):
        assert float(getattr(of, name)[0]) == pytest.approx(value, rel=1e-3)
    assert float(asset.medium.g[0]) == pytest.approx(mean[3] / mean[1], rel=3e-3)


def test_masses_are_those_of_core_and_coating(write):
    """1 um^3 in all: a core of 0.3 um^3 of 1.8 g/cm^3 in 0.7 um^3 of 1.2 g/cm^3 weighs 1.38e-12 g."""
    keys = f"density: 1.8 g/cm^3, coating: {COAT}volume_share: 70%, density: 1.2 g/cm^3}}"
    radius = (0.3 * 3 / (4 * np.pi)) ** (1 / 3)
    recipe = load(write(keys, "mass_concentration: 1.38 ug/m^3", f"{{distribution: single, radius: {radius!r} um}}"))
    assert amounts(recipe.particles, *dry(recipe.particles))[0] == pytest.approx(1e6, rel=1e-12)


# ---- growth


def test_opac_sulphate_at_99_percent(write, tmp_path):
    """OPAC 3.1, data file suso99: of dry radius, growth and dry index its extinction, asymmetry and wet index at 0.55 um."""
    size = "{distribution: lognormal, radius: 0.0695 um, sigma: 2.03, min: 0.0031 um, max: 20 um}"
    table = "relative_humidity_percent,growth_factor\n0,1\n99,3.323741\n"
    keys = "growth: {file: growth.csv, material: {n: 1.333, k: 1.96e-9}}"
    path = write(keys, "number_density: 1 /cm^3\nrelative_humidity: 99%", size, "{n: 1.43, k: 1e-8}", "phase: {method: mie}\n",
                 growth=table)
    assert complex(component(load(path)).m[0]) == pytest.approx(1.336 + 2.179e-9j, abs=5e-4)
    assert component(load(path)).m[0].imag == pytest.approx(2.179e-9, rel=2e-3)
    medium = bakery.open(bakery.bake(path, tmp_path / "a.h5")).medium
    assert 1e3 * float(medium.sigma_t[0]) == pytest.approx(1.209e-3, rel=5e-3)
    assert float(medium.g[0]) == pytest.approx(0.797, abs=2e-3)


def test_dry_air_leaves_particles_as_they_are(write, tmp_path):
    there = extinction(write("fraction: 1"), tmp_path)
    for mixing in ("volume", "bruggeman", "maxwell_garnett", "lorentz_lorenz", "shell"):
        path = write(f"growth: {{kappa: 0.6, mixing: {mixing}}}", "number_density: 1e9 /m^3\nrelative_humidity: 0")
        assert extinction(path, tmp_path) == there


def test_water_mixes_or_lies_around(write, tmp_path):
    k, g = 2 * np.pi / 0.55, (1 + 0.5 * 4) ** (1 / 3)
    humid = "number_density: 1e9 /m^3\nrelative_humidity: 80%"
    water = "material: {n: 1.33}"
    shell = extinction(write(f"growth: {{kappa: 0.5, {water}, mixing: shell}}", humid), tmp_path)
    assert shell == pytest.approx(coated_efficiencies(SOOT, 1.33, k * 0.1, k * 0.1 * g)[0] * np.pi * (0.1 * g) ** 2, rel=1e-12)
    volume = extinction(write(f"growth: {{kappa: 0.5, {water}}}", humid), tmp_path)
    mean = SOOT / 3 + 1.33 * 2 / 3
    assert volume == pytest.approx(efficiencies(mean, k * 0.1 * g)[0] * np.pi * (0.1 * g) ** 2, rel=1e-12)


def test_a_coating_takes_up_water_by_its_volume(write, tmp_path):
    """Core 1, coating 7 of the volume; at kappa 0.5 and 80 % the coating becomes 21."""
    path = write(f"growth: {{kappa: 0.5, material: {{n: 1.33}}}}, coating: {COAT}ratio: 2}}",
                 "number_density: 1e9 /m^3\nrelative_humidity: 80%")
    k, whole = 2 * np.pi / 0.55, 0.1 * 22 ** (1 / 3)
    there = coated_efficiencies(SOOT, SULPHATE / 3 + 1.33 * 2 / 3, k * 0.1, k * whole)[0] * np.pi * whole**2
    assert extinction(path, tmp_path) == pytest.approx(there, rel=1e-12)


def test_amounts_are_those_of_dry_particles(write):
    keys = "density: 2 g/cm^3, growth: {kappa: 1}"
    wet, dried = (load(write(keys, f"mass_concentration: 10 ug/m^3\nrelative_humidity: {h}")).particles for h in ("95%", "0%"))
    assert amounts(wet, *dry(wet)) == amounts(dried, *dry(dried))


def test_humidity_can_be_swept(write, tmp_path):
    path = write("growth: {kappa: 0.6}", "number_density: 1e9 /m^3\nrelative_humidity: 0%", material="{n: 1.43}",
                 more="sweep: {particles.relative_humidity: ['0%', '50%', '80%'], refine: false}\n")
    family = bakery.open(bakery.bake(path, tmp_path / "a.h5"))
    dried = family.at(relative_humidity=0.0).medium.sigma_t[0]
    assert float(family.at(relative_humidity=0.8).medium.sigma_t[0]) > float(dried)


def test_separate_particles_are_wet_too(write, tmp_path):
    """Their radii, indices and numbers are those of `optics` and `medium`."""
    path = write("growth: {kappa: 0.5, material: {n: 1.33}}, density: 1 g/cm^3",
                 "mass_concentration: 40 ug/m^3\nrelative_humidity: 80%",
                 more="discrete: {box: [0.1 mm, 0.1 mm, 0.1 mm], count: 50}\n")
    asset = bakery.open(bakery.bake(path, tmp_path / "a.h5"))
    grown = 3 ** (1 / 3)
    of = asset.discrete["a"]
    assert float(of.radius[0]) == pytest.approx(0.1 * grown, rel=1e-6)
    assert (float(of.n[0]), float(of.k[0])) == pytest.approx((1.95 / 3 + 1.33 * 2 / 3, 0.79 / 3), rel=1e-12)
    number = 40e-9 / (4 / 3 * np.pi * 1e-21 * 1000)
    cross_section = float(asset.optics["a"].mean_extinction[0])
    assert float(asset.medium.sigma_t[0]) == pytest.approx(number * 1e-12 * cross_section, rel=1e-12)


def test_five_hundred_wavelengths(write, tmp_path):
    path = write(f"coating: {COAT}ratio: 1.5}}, growth: {{kappa: 0.6, material: {{n: 1.33}}}}",
                 "number_density: 1e9 /m^3\nrelative_humidity: 80%")
    waves = np.round(np.linspace(0.3, 2.0, 500), 6)
    path.write_text(path.read_text().replace("[0.55]", str(waves.tolist())).replace("tolerance: 3%", "tolerance: 30%"))
    extinction = np.asarray(bakery.open(bakery.bake(path, tmp_path / "a.h5", stages=["optics"])).optics["a"].mean_extinction)
    assert extinction.shape == (500,)
    shell, outer = (1 + 3.4 * (1.5**3 - 1)) ** (1 / 3), SULPHATE / 3.4 + 1.33 * 2.4 / 3.4
    k = 2 * np.pi / waves[77]
    there = coated_efficiencies(SOOT, outer, k * 0.1, k * 0.1 * shell)[0] * np.pi * (0.1 * shell) ** 2
    assert extinction[77] == pytest.approx(there, rel=1e-12)


@pytest.mark.slow
def test_masses_and_shells_can_be_swept(write, tmp_path):
    """sigma_t goes with the mass of the particles, which grows with their shells."""
    keys = f"density: 1.8 g/cm^3, coating: {COAT}thickness: 10 nm, density: 1.77 g/cm^3}}"
    path = write(keys, "mass_concentration: 10 ug/m^3", more="sweep:\n  particles.mass_concentration: '[5, 50] ug/m^3'\n"
                 "  particles.components.a.coating.thickness: '[0, 20] nm'\n  refine: false\n")
    family = bakery.open(bakery.bake(path, tmp_path / "a.h5"))
    light, heavy = (float(family.at(mass_concentration=c, thickness=0.0).medium.sigma_t[0]) for c in (5e-9, 50e-9))
    assert heavy == pytest.approx(10 * light, rel=1e-12)
    assert family.axes["mass_concentration"].values.units == "kg/m^3"


# ---- mixtures


def test_a_mixed_material_is_one_index(write, tmp_path):
    mixture = "{mixing: volume, of: [{material: {n: 1.95, k: 0.79}, share: 25%}, {material: {n: 1.43}, share: 75%}]}"
    index = load(write("fraction: 1", material=mixture)).particles.components[0].material
    assert (index.n[0], index.k[0]) == pytest.approx((0.25 * 1.95 + 0.75 * 1.43, 0.25 * 0.79), rel=1e-14)
    garnett = "{mixing: maxwell_garnett, matrix: water, of: [{material: soot, share: 5%}]}"
    index = load(write("fraction: 1", material=garnett)).particles.components[0].material
    assert index.n[0] == pytest.approx(1.36, abs=0.01) and 0.01 < index.k[0] < 0.05


@pytest.mark.parametrize("keys, of_all, message", [
    (f"coating: {COAT}thickness: 10 nm, ratio: 2}}", "", "found ratio beside thickness"),
    ("coating: {material: water}", "", "found no thickness of the shell"),
    (f"coating: {COAT}ratio: 0.5}}", "", "at least 1"),
    (f"coating: {COAT}volume_share: 100%}}", "", "below 1"),
    (f"coating: {COAT}thickness: -1 nm}}", "", "at least 0"),
    ("coating: {material: watr, ratio: 2}", "", "an unknown material"),
    (f"density: 1 g/cm^3, coating: {COAT}ratio: 2}}", "mass_concentration: 1 ug/m^3", r"coating: found no density, which mass"),
    ("growth: {kappa: 0.6}", "", "found growth without a humidity; expected particles.relative_humidity, such as 80%"),
    ("fraction: 1", "relative_humidity: 50%", "found relative_humidity, and no component that grows"),
    ("growth: {kappa: 0.6}", "relative_humidity: 100%", "below 1"),
    ("growth: {kappa: 0.6}", "relative_humidity: 80", r"below 1 \(80 %\?\)"),
    ("growth: {kappa: -1}", "relative_humidity: 80%", "at least 0"),
    ("growth: {kappa: 5}", "relative_humidity: 0.9999999", "a growth by a factor of 368; expected at most 100"),
    (f"coating: {COAT}thickness: 1 m}}", "", "brings particles to a size parameter of 1.14e[+]07"),
    ("growth: {material: water}", "relative_humidity: 80%", "found neither kappa nor file"),
    ("growth: {kappa: 0.6, mixing: onion}", "relative_humidity: 80%", "expected bruggeman, .*, volume or shell"),
    (f"growth: {{kappa: 0.6}}, coating: {COAT}thickness: 10 nm}}", "relative_humidity: 80%", "thickness of a coating that grows"),
    (f"growth: {{kappa: 0.6, mixing: shell}}, coating: {COAT}ratio: 2}}", "relative_humidity: 80%", "a shell around a coating"),
])
def test_wrong_layers_are_refused(write, keys, of_all, message):
    if "mass_concentration" not in of_all:
        of_all = f"number_density: 1e9 /m^3\n{of_all}".strip()
    with pytest.raises(RecipeError, match=r"air.yaml:\d+: .*" + message):
        load(write(keys, of_all))


@pytest.mark.parametrize("more, message", [("phase: {method: goa}\n", "which rays do not know"),
                                           ("discrete: {box: [1 mm, 1 mm, 1 mm]}\n", "a coating beside discrete")])
def test_coated_spheres_have_no_rays_and_no_places(write, more, message):
    with pytest.raises(RecipeError, match=message):
        load(write(f"coating: {COAT}ratio: 2}}", more=more))


@pytest.mark.parametrize("table, message", [
    ("relative_humidity_percent,growth_factor\n0,1\n100,3\n", "a humidity of 100 %"),
    ("relative_humidity_percent,growth_factor\n0,1.2\n90,3\n", "1.2 at humidity 0"),
    ("relative_humidity_percent,growth_factor\n0,1\n50,1.2\n", "up to the relative_humidity of 80 %"),
    ("relative_humidity_percent,growth_factor\n0,1\n90,0.5\n", "a growth factor of 0.5"),
    ("relative_humidity_percent,growth_factor\n50,1.1\n40,1.2\n", "growth.csv:3: .*ascending"),
    ("relative_humidity,growth_factor\n0,1\n90,2\n", "no unit for the column"),
])
def test_wrong_growth_tables_are_refused(write, table, message):
    with pytest.raises(RecipeError, match=message):
        load(write("growth: {file: growth.csv}", "number_density: 1e9 /m^3\nrelative_humidity: 80%", growth=table))


@pytest.mark.parametrize("material, message", [
    ("{mixing: volume, of: [{material: soot, share: 0.5}]}", "shares that add up to 0.5"),
    ("{mixing: volume, matrix: water, of: [{material: soot, share: 1}]}", "found volume with a matrix"),
    ("{mixing: maxwell_garnett, of: [{material: soot, share: 0.5}]}", "found maxwell_garnett without a matrix"),
    ("{mixing: maxwell_garnett, matrix: water, of: [{material: soot, share: 1}]}", "expected less than 1 in a matrix"),
    ("{mixing: stirred, of: [{material: soot, share: 1}]}", "expected bruggeman, maxwell_garnett, lorentz_lorenz or volume"),
    ("{of: [{material: soot, share: 1}]}", "mixing: missing"),
    ("{mixing: volume, of: []}", "at least 1"),
    ("{mixing: volume, of: [{material: soott, share: 1}]}", r"unknown material.*\(soot\?\)"),
    ("{mixing: volume, of: [{material: {mixing: volume, of: [{material: soot, share: 1}]}, share: 1}]}", "unknown key|missing"),
    ("[soot]", r"\{mixing: …, of: …\}"),
])
def test_wrong_mixtures_are_refused(write, material, message):
    with pytest.raises(RecipeError, match=r"air.yaml:\d+: .*(" + message + ")"):
        load(write("fraction: 1", material=material))
