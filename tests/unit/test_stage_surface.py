"""Stage `surface`: what an asset says of plane layers, against the solver, laws of conservation and each other."""

import math
from dataclasses import replace

import numpy as np
import pytest

import bakery
from bakery.errors import RecipeError, UsageError
from bakery.kernels import surface_transmittance
from bakery.physics.multiple.legendre import moments
from bakery.physics.surfaces import fresnel
from bakery.physics.surfaces.slab import Slab
from bakery.physics.surfaces.solution import solve
from bakery.physics.surfaces.table import GRIDS
from bakery.recipe import load
from bakery.stages import conform
from bakery.stages.surface import costs
from bakery.stages.surface import stage as surface
from bakery.stages.surface.files import csv_tables
from bakery.stages.surface.spread import has_spread
from bakery.stages.surface.triangles import integers, numbers
from bakery.stages.surface.view import solutions_of
from bakery.store.tree import Dataset, Group
from tests.conftest import ROOT

RECIPE = """\
bakery: 1
name: layer
wavelengths: [0.45, 0.65]
tolerance: 2%
medium: {albedo: [1, 0.9], mean_free_path: 1 mm, phase: {type: hg, g: 0.6}}
surface: {options}
"""
THETA = np.radians([0.0, 20.0, 50.0, 75.0, 89.0])


@pytest.fixture(scope="module")
def bake(tmp_path_factory):
    folder = tmp_path_factory.mktemp("surface")

    def bake(name, options, path="1 mm"):
        (folder / "layer.yaml").write_text(RECIPE.replace("{options}", options).replace("1 mm, phase", f"{path}, phase"))
        return bakery.open(bakery.bake(folder / "layer.yaml", output=folder / f"{name}.h5"))

    return bake


@pytest.fixture(scope="module")
def deep(bake):
    return bake("deep", "{boundary: {index: 1.4}}")


@pytest.fixture(scope="module")
def thin(bake):
    return bake("thin", '{thickness: "[0, 0.5, 3] mm"}')


@pytest.fixture(scope="module")
def based(bake):
    return bake("based", "{thickness: 1 mm, boundary: {index: 1.3, roughness: 0.3}, base: {albedo: [1, 0.5]}}")


AROUND = THETA[:, None, None], THETA[:, None], 2 * np.pi * np.arange(256) / 256  # no order above 0 is left of their mean


def compare(value, true, at, rounding):
    """As they are, or around the azimuth on the average."""
    if at is AROUND:
        value, true = value.mean(axis=-1), true.mean(axis=-1)
    np.testing.assert_allclose(value, true, rtol=rounding)


def test_what_is_looked_up_is_the_solvers(deep, thin):
    """To the rounding of what is stored, which the tolerance of 2 % allows: a tenth of it; means over azimuth, which are not
    rounded, to single precision."""
    theta, phase = np.asarray(thin.medium.theta), np.asarray(thin.medium["phase"][1])
    at = THETA[:, None], THETA, 1.0
    cases = (deep, math.inf, 1.4, "reflectance"), (thin, 3.0, 1.0, "reflectance"), (thin, 3.0, 1.0, "transmittance")
    for asset, depth, index, name in cases:
        count = int(asset.surface.moments)
        solution = solve(Slab(theta, phase, 0.9, depth, index), moments(theta, phase, count + 1), count, 0.02)
        exact = solution.reflection if name == "reflectance" else solution.transmission
        for about, rounding in ((at, 2e-3), (AROUND, 1e-6)):
            value = getattr(asset.surface, name)(*about)[1]
            compare(value if asset is deep else value[-1], exact(np.cos(about[1]), np.cos(about[0]), about[2]), about, rounding)


@pytest.mark.parametrize("name", ["deep", "thin", "based"])
def test_reciprocity(name, request):
    layer = request.getfixturevalue(name).surface
    for function in (layer.reflectance, layer.transmittance):
        there, back = function(THETA[:, None], THETA, 0.7), function(THETA, THETA[:, None], 0.7)
        np.testing.assert_allclose(there, back, rtol=1e-6, atol=1e-12)


def test_energy(deep, thin, based):
    """Nothing is lost at an albedo of 1, whatever the layer; and no light comes from nowhere."""
    for asset in (deep, based):
        np.testing.assert_allclose(asset.surface.albedo(THETA)[0], 1, atol=1e-6)
    np.testing.assert_allclose(np.asarray(thin.surface["albedo"] + thin.surface["passed"])[0], 1, atol=1e-6)
    assert (thin.surface.albedo(THETA)[1, 2, :4] < 0.5).all()


def test_lobes_add_up_to_albedos(deep, thin):
    """R times the cosine, over a fine grid of directions, is the albedo, within the tolerance."""
    x, weight = np.polynomial.legendre.leggauss(60)
    cosine, phi = 0.5 * (1 + x), math.pi * (np.arange(60) + 0.5) / 60
    for asset, mirrored in ((deep, ((1.4 - 1) / (1.4 + 1)) ** 2), (thin, 0.0)):
        lobe = asset.surface.reflectance(0.0, np.arccos(cosine)[:, None], phi)
        back = mirrored + lobe.mean(axis=-1) @ (weight * cosine)
        np.testing.assert_allclose(back, asset.surface.albedo(0.0), rtol=0.01, atol=1e-9)


def test_albedos_of_thin_layers_and_of_low_index(bake):
    """Between the solver's directions: a layer of 0.001 mean free paths sends back what its lobe adds up to, and light from all
    sides the mean over cosines, also where an index below 1 reflects half of it totally."""
    x, weight = np.polynomial.legendre.leggauss(60)
    cosine, weight, phi = (0.5 * (1 + x))**3, 1.5 * weight * (0.5 * (1 + x))**2, math.pi * (np.arange(60) + 0.5) / 60
    film = bake("film", "{thickness: 0.001 mm}").surface
    lobe = film.reflectance(THETA[:, None, None], np.arccos(cosine)[:, None], phi)
    np.testing.assert_allclose(film.albedo(THETA), 2 * lobe.mean(axis=-1) @ (weight * cosine), rtol=2e-3)
    rare = bake("rare", "{thickness: 1 mm, boundary: {index: 0.7}}").surface
    entering = math.sqrt(1 - 0.7**2) + cosine * (1 - math.sqrt(1 - 0.7**2))
    mean = 0.51 + 2 * (1 - math.sqrt(1 - 0.7**2)) * (rare.albedo(np.arccos(entering)) @ (weight * entering))
    np.testing.assert_allclose(rare["spherical_albedo"][:, 0], mean, atol=1e-3)


def test_layers(thin, based):
    assert thin.surface.reflectance(0.3, THETA).shape == (2, 3, 5) and based.surface.reflectance(0.3, THETA).shape == (2, 5)
    assert (thin.surface.reflectance(0.3, THETA)[:, 0] == 0).all() and (thin.surface["passed"][:, 0] == 1).all()
    assert (np.diff(thin.surface["spherical_albedo"], axis=1) > 0).all()
    assert (based.surface.transmittance(0.3, THETA) == 0).all() and "transmitted" not in based.surface
    with pytest.raises(ValueError, match="below pi/2"):
        thin.surface.albedo(math.pi / 2)


def test_queries(thin):
    answer = thin.query("surface/reflected", theta_in="30 deg", theta_out="[0, 60] deg")
    np.testing.assert_array_equal(answer.values, thin.surface.reflectance(np.radians(30), np.radians([0, 60])))
    assert [name for name, *_ in answer.axes] == ["wavelength", "thickness", "theta_out"]
    np.testing.assert_allclose(answer.error, answer.values * thin.surface["change"][..., None])
    assert thin.query("surface/albedo", theta_in="30 deg").values.shape == (2, 3)
    with pytest.raises(UsageError, match="theta_out missing"):
        thin.query("surface/reflected", theta_in="30 deg")
    with pytest.raises(UsageError, match="below pi/2"):
        thin.query("surface/albedo", theta_in="90 deg")


def test_pictures_and_files(thin):
    """Numbers of pictures and files are those that the asset gives."""
    from bakery.stages.surface.pictures import pictures

    shown = {picture.name: dict(picture.columns) for picture in pictures(thin.tree)}
    assert set(shown) == {f"surface_{part}{layer}" for part in ("lobes", "transmitted", "albedo", "spread")
                          for layer in ("", "_1", "_2")} - {"surface_spread"}  # the first is no layer
    for layer, ending in enumerate(("", "_1", "_2")):
        column = shown[f"surface_albedo{ending}"]["albedo [1] at 0.65 um"]
        assert column[30] == pytest.approx(thin.surface.albedo(np.radians(30.0))[1, layer])
        lobes, at = shown[f"surface_lobes{ending}"], 179 + 149  # from 30 to 60 degrees
        assert (lobes["from [deg]"][at], lobes["to [deg]"][at]) == (30, 60)
        values = thin.surface.reflectance(np.radians(30), np.radians(60), layer=layer)
        assert lobes["reflectance [1] at 0.65 um"][at] == pytest.approx(values[1])
    files, told = csv_tables(thin.tree)
    assert set(files) == {"surface_reflected.csv", "surface_transmitted.csv", "surface_albedo.csv"}
    assert {"surface/reflected", "surface/reflected_exponent"} <= told  # exponents without what they count are no numbers
    assert files["surface_albedo.csv"].splitlines()[0].count("um thick") == 6


@pytest.mark.parametrize("options, says", [
    ("{base: {albedo: 0.5}}", "base under an infinite layer"),
    ("{thickness: 1 mm, boundary: {index: 1.3, roughness: 0.2}}", "rough boundary of a layer on nothing"),
    ("{boundary: {index: 1.3, roughness: 0.01}}", "expected 0, or 0.05 to 1"),
    ("{thickness: 1 mm, base: {albedo: [0.1, 0.2, 0.3]}}", "3 values for 2 wavelengths"),
    ("{thickness: -1 mm}", "at least 0"),
    ("{boundary: {index: 0.1}}", "at least 0.5"),
])
def test_recipes_that_are_refused(tmp_path, options, says):
    (tmp_path / "layer.yaml").write_text(RECIPE.replace("{options}", options))
    with pytest.raises(RecipeError, match=says):
        load(tmp_path / "layer.yaml")


@pytest.mark.slow
def test_a_missed_tolerance_is_said(tmp_path):
    """A lobe so narrow that no number of moments tells light that grazes in and out."""
    (tmp_path / "layer.yaml").write_text(RECIPE.replace("{options}", "{tolerance: 0.01%}").replace("g: 0.6", "g: 0.99")
                                         .replace("[0.45, 0.65]", "[0.45]").replace("[1, 0.9]", "0.5"))
    from bakery.physics.surfaces import refine

    recipe = load(tmp_path / "layer.yaml")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(refine.refined, "__defaults__", (36,))
        values = {"sigma_t": np.array([1e3]), "sigma_s": np.array([500.0]), "theta": np.array([0, 0.1, math.pi]),
                  "phase": np.array([[20.0, 0.05, 0.05]]), "thickness": None, "index": 1.0, "roughness": 0.0, "base": None}

        class Context:
            tolerance, seed = recipe.surface.tolerance, 0
            map = staticmethod(lambda function, tasks: [function(*task) for task in tasks])
            report = staticmethod(lambda *_: None)

        result = surface.compute(values, Context())
    assert result.achieved_error > 1e-4 and "a larger surface.tolerance would do" in result.missed[0]


def test_broken_groups_are_told(thin):
    group = thin.tree["surface"]

    def broken(**changes):
        members = {name: Dataset(changes.get(name, member.data), member.units, member.description)
                   for name, member in group.members.items()}
        return conform.broken(surface.STAGE, Group(members, dict(group.attributes)))

    assert not broken()
    assert broken(albedo=np.minimum(group["albedo"].data + 0.1, 1)) == ["more light leaves than enters",
                                                                       "spherical_albedo is not the mean of albedo"]
    assert broken(cosine=group["cosine"].data[::-1]) == ["cosine does not ascend from 0"]
    shorter = {name: group[name].data[..., 1:] for name in ("reflected", "reflected_exponent")}
    assert broken(**shorter) == ["reflected does not hold one value a pair of directions"]
    exponent = group["reflected_exponent"].data
    (fault,) = broken(reflected_exponent=exponent[..., 1:, :])
    assert fault.startswith("surface/reflected_exponent: its shape is")
    assert broken(reflected=group["reflected"].data.astype(float)) == ["reflected_exponent without integers"]
    members = {name: member for name, member in group.members.items() if name != "reflected_exponent"}
    assert conform.broken(surface.STAGE, Group(members, {})) == ["reflected holds integers without reflected_exponent"]


def test_rounded_orders_are_integers_times_powers_of_two():
    """Exactly; numbers that are not rounded, or too far apart, stay as they are."""
    rng = np.random.default_rng(1)
    values = np.ldexp(rng.integers(-2000, 2000, (2, 7, 5)), rng.integers(-90, 20, (2, 1, 5))).astype(float)
    values[:, 0] = rng.standard_normal((2, 5)).astype(np.float32)
    values[0, :, 0] = values[1, 1::2, 1] = 0
    multiples, exponents = integers(values)
    assert multiples.dtype == np.int32 and exponents.dtype == np.int8 and exponents.shape == (2, 3, 5)
    np.testing.assert_array_equal(numbers(multiples, exponents), values)
    assert integers(rng.standard_normal((1, 9, 50))) is None
    assert integers(np.array([[1.0], [1.0], [1.0], [2.0**-40]])) is None
    assert integers(np.full((3, 1), 2.0**-140)) is None


def test_spread(deep, thin, based, bake):
    """Distances grow with the mean free path, whatever the wavelengths; shares add up to what comes out."""
    surface_of, wider = deep.surface, bake("wider", "{boundary: {index: 1.4}}", "2 mm").surface
    np.testing.assert_allclose(wider["spread_radius"], 2 * surface_of["spread_radius"], rtol=1e-12)
    np.testing.assert_array_equal(wider["spread"], surface_of["spread"])
    for name, power in (("mean_square", 2), ("mean_square_error", 2), ("spread_square", 2), ("profile", 1)):
        np.testing.assert_allclose(wider[name], 2**power * surface_of[name], rtol=1e-9)
    # a mean free path is 1 mm: absorbed light does not come far
    assert 1 < math.sqrt(surface_of["mean_square"][1, 0]) / 1e3 < 6 < math.sqrt(surface_of["mean_square"][0, 0]) / 1e3
    shares = surface_of.spread_within([0, 1e2, 1e3, 1e4, 1e9])
    assert shares.shape == (2, 5) and (np.diff(shares, axis=1) >= 0).all() and (shares[:, 0] == 0).all()
    np.testing.assert_allclose(shares[1, -1], 1, atol=1e-6)
    assert thin.surface.spread_within(1e3).shape == (2, 3) and (thin.surface["spread"][:, 0] == 0).all()
    assert based.surface["profile_misfit"].max() < 0.2
    answer = deep.query("surface/spread", radius="[1, 10] mm")
    np.testing.assert_array_equal(answer.values, surface_of.spread_within([1e3, 1e4]))
    assert answer.axes[-1][:2] == ("radius", "um")
    with pytest.raises(UsageError, match="phi has no effect"):
        deep.query("surface/spread", phi="0 deg")
    with pytest.raises(ValueError, match="radius -1"):
        surface_of.spread_within([1, -1])
    with pytest.raises(ValueError, match="phi nan"):
        surface_of.reflectance(0.1, 0.2, math.nan)


@pytest.mark.slow
@pytest.mark.parametrize("options", [
    '{thickness: "[0.01, 1e6] mm"}', '{thickness: "[0.01, 1e6] mm", boundary: {index: 0.75}, base: {albedo: 1}}',
    "{boundary: {index: 0.75, roughness: 0.2}}"])
def test_extremes(options, tmp_path):
    """Depths 0.01 to 1e6, albedo 0 and 1, an index below 1, facets, incidence to 89.9 degrees: numbers, energy, both ways."""
    recipe = RECIPE.replace("[0.45, 0.65]", "[0.45, 0.55, 0.65]").replace("[1, 0.9]", "[1, 0.5, 0]")
    (tmp_path / "layer.yaml").write_text(recipe.replace("{options}", options))
    of = bakery.bake(tmp_path / "layer.yaml", output=tmp_path / "layer.h5").surface
    theta = np.radians([0.0, 40.0, 80.0, 89.9])
    values = of.reflectance(theta[:, None], theta, 1.0)
    assert np.isfinite(values).all() and (values >= 0).all() and (of["change"] <= 0.02).all()
    np.testing.assert_allclose(values, np.swapaxes(values, -1, -2), rtol=1e-6)
    np.testing.assert_allclose((of["albedo"] + of["passed"])[0], 1, atol=1e-6)
    assert (of["mean_square"][0] > 0).all() and np.isfinite(of["mean_square"]).all()


@pytest.mark.slow
@pytest.mark.parametrize("index", [1.5, 0.7])
def test_a_painted_base_under_a_boundary_alone(bake, index):
    """No medium between a smooth boundary and a Lambertian base of albedo b: r + (1 - r) (1 - R) b / (1 - R b) comes back.  R is
    the share of light from all sides that the boundary sends back into the medium (0.596 at 1.5: Judd 1942); the BRDF is that of
    Wolff, Nayar & Oren 1998 (IJCV 30, 55)."""
    layer = bake("painted", f'{{thickness: "[0, 1e-22] mm", boundary: {{index: {index}}}, base: {{albedo: [0.5, 1]}}}}')
    mu = np.cos(THETA)
    x, weight = np.polynomial.legendre.leggauss(400)
    inner, weight = 0.5 * (1 + x), 0.5 * weight
    sine = index * np.sqrt(1 - inner**2)
    into = np.where(sine < 1, fresnel.reflected(np.sqrt(np.maximum(1 - sine**2, 0)), index), 1.0)
    back, first = float(np.sum(2 * inner * into * weight)), fresnel.reflected(mu, index)
    assert index != 1.5 or back == pytest.approx(0.596, abs=5e-4)
    for k, albedo in enumerate((0.5, 1.0)):
        for t in range(2):
            lit = albedo / (1 - back * albedo)
            assert layer.surface.albedo(THETA)[k, t] == pytest.approx(first + (1 - first) * (1 - back) * lit, rel=1e-3)
            brdf = layer.surface.reflectance(THETA, THETA[1], 0.7)[k, t]
            assert brdf == pytest.approx((1 - first) * (1 - first[1]) / index**2 * lit, rel=2e-3)


def test_measures(thin):
    group = thin.tree["surface"]
    assert surface.measures(group, group)["error"] < 1e-9


# ---- layers of several assets

OF_SOIL = '{thickness: "[0.1, 1] mm", boundary: {index: 1.2}, base: {albedo: [0.3, 0.3, 0.2]}}'
SOIL = f"""\
bakery: 1
name: soil
wavelengths: [0.45, 0.55, 0.65]
tolerance: 2%
medium: {{albedo: [0.5, 0.6, 0.9], mean_free_path: 0.1 mm, phase: {{type: hg, g: 0.3}}}}
surface: {OF_SOIL}
"""
OVER = "{thickness: 0.5 mm, boundary: {index: 1.4}, base: {OTHER, layer: 1}}"


@pytest.fixture(scope="module")
def soil(tmp_path_factory):
    folder = tmp_path_factory.mktemp("layers")
    (folder / "soil.yaml").write_text(SOIL)
    (folder / "top.yaml").write_text(RECIPE.replace("{options}", OVER.replace("OTHER", "asset: soil.h5")))
    (folder / "above.yaml").write_text(RECIPE.replace("{options}", OVER.replace("OTHER", "recipe: soil.yaml")))
    bakery.bake(folder / "soil.yaml", output=folder / "soil.h5")
    bakery.bake(folder / "top.yaml", output=folder / "top.h5")
    return folder


def test_the_base_of_another_asset_is_its_layer(soil):
    """The solver's own values but for rounding, at the wavelengths picked; a recipe in its place gives the same bytes."""
    asset, base = (bakery.open(soil / name) for name in ("top.h5", "soil.h5"))
    theirs, ours = base.medium, asset.medium
    lower = Slab(np.asarray(theirs.theta), np.asarray(theirs["phase"][2]), 0.9, 10.0, 1.2, 0.2)
    slab = Slab(np.asarray(ours.theta), np.asarray(ours["phase"][1]), 0.9, 0.5, 1.4, under=lower)
    count = int(asset.surface.moments)
    solution = solve(slab, [moments(part.theta, part.phase, count + 1) for part in (slab, lower)], count, 0.02)
    at = THETA[:, None], THETA, 1.0
    value = asset.surface.reflectance(*at)
    for about, rounding in ((at, 2e-3), (AROUND, 1e-6)):
        true = solution.reflection(np.cos(about[1]), np.cos(about[0]), about[2])
        compare(asset.surface.reflectance(*about)[1], true, about, rounding)
    other = bakery.bake(soil / "above.yaml", output=soil / "above.h5")
    np.testing.assert_array_equal(other.surface.reflectance(*at), value)
    np.testing.assert_allclose(value, asset.surface.reflectance(THETA, THETA[:, None], 1.0), rtol=1e-6)
    assert (asset.surface["passed"] == 0).all()
    assert not list(surface.check(asset.tree["surface"]))


def test_spread_of_layers_on_each_other(soil):
    """Lengths are those of each medium: soil's are ten times as short.  Walks are checked in physics/surfaces/test_spread.py."""
    from bakery.physics.surfaces.spread import spread

    asset = bakery.open(soil / "top.h5")
    np.testing.assert_allclose(asset.surface["under_length"], 100, rtol=1e-6)
    row = asset.surface._rows()[1][0]
    assert row.slab.length == pytest.approx(1000, rel=1e-6)
    walked = spread(row.slab, 0, 1, 0, tolerance=0.04)
    np.testing.assert_allclose(asset.surface["mean_square"][1, 0], walked.mean_square, rtol=1e-3)
    assert asset.surface.spread_within(1e9)[1] == pytest.approx(1, abs=1e-3)
    members = {name: member for name, member in asset.tree["surface"].members.items() if name != "under_length"}
    former = solutions_of(Group(members, {}), asset.tree["medium"])[0][0].slab
    assert math.isnan(former.under.length) and not has_spread(former)


@pytest.mark.slow
def test_a_third_layer_needs_no_file_but_that_under_it(soil):
    (soil / "third.yaml").write_text(RECIPE.replace("{options}", "{thickness: 0.2 mm, base: {asset: top.h5}}"))
    asset = bakery.bake(soil / "third.yaml", output=soil / "third.h5")
    assert asset.surface["under_index"].tolist() == [1.4, 1.2]
    slabs = [row[0].slab for row in asset.surface._rows()]
    assert [slab.under.under.base for slab in slabs] == [0.3, 0.2] and slabs[1].under.under.depth == pytest.approx(10)


@pytest.mark.slow
def test_air_below_layers_on_each_other(soil, monkeypatch):
    """What leaves below is stored as a square, for it is not the same from both sides; tables are of either."""
    (soil / "free.yaml").write_text(RECIPE.replace("{options}", "{thickness: 1 mm}"))
    (soil / "over.yaml").write_text(RECIPE.replace("{options}", "{thickness: '[0.2, 2] mm', boundary: {index: 1.4}, base: "
                                                   "{recipe: free.yaml}}"))
    asset = bakery.bake(soil / "over.yaml", output=soil / "over.h5")
    assert not list(surface.check(asset.tree["surface"]))
    np.testing.assert_allclose((asset.surface["albedo"] + asset.surface["passed"])[0], 1, atol=1e-6)
    at = THETA[:, None], THETA, 1.0
    upper, lower = (Slab(np.asarray(asset.medium.theta), np.asarray(asset.medium["phase"][1]), 0.9, depth, index)
                    for depth, index in ((2.0, 1.4), (1.0, 1.0)))
    turned = replace(lower, under=upper)
    rows = [moments(part.theta, part.phase, 49) for part in (turned, upper)]
    true = solve(turned, rows, 48, 1e-3).transmission(np.cos(at[0]), np.cos(at[1]), at[2])
    np.testing.assert_allclose(asset.surface.transmittance(*at)[1, 1], true, rtol=0.02)
    monkeypatch.setattr("bakery.physics.surfaces.table.GRIDS", GRIDS[:1])  # test_stack has the finest
    tables = [asset.surface.table(1, from_below=side)[0] for side in (False, True)]
    assert [table.index for table in tables] == [table.index_below for table in tables[::-1]] == [1.4, 1.0]
    down, up = (surface_transmittance(table, 1, *mu, 0.5) for table, mu in zip(tables, ((0.3, 0.8), (0.8, 0.3)), strict=True))
    assert down == pytest.approx(up, rel=5e-3) and down > 0.01
    with pytest.raises(UsageError, match="no light enters from below"):
        bakery.open(soil / "top.h5").surface.table(from_below=True)


@pytest.mark.slow
def test_layers_under_facets(soil):
    """A rough coat of the soil's index on it: the solver's values, and in loops."""
    options = "{thickness: 0.2 mm, boundary: {index: 1.2, roughness: 0.3}, base: {recipe: soil.yaml, layer: 1}}"
    (soil / "coat.yaml").write_text(RECIPE.replace("{options}", options))
    asset, base = bakery.bake(soil / "coat.yaml", output=soil / "coat.h5"), bakery.open(soil / "soil.h5")
    assert not list(surface.check(asset.tree["surface"]))
    lower = Slab(np.asarray(base.medium.theta), np.asarray(base.medium["phase"][2]), 0.9, 10.0, 1.2, 0.2)
    slab = Slab(np.asarray(asset.medium.theta), np.asarray(asset.medium["phase"][1]), 0.9, 0.2, 1.2, None, 0.3, lower)
    count = int(asset.surface.moments)
    solution = solve(slab, [moments(part.theta, part.phase, count + 1) for part in (slab, lower)], count, 0.02)
    at = THETA[:, None], THETA, 1.0
    for about, rounding in ((at, 2e-3), (AROUND, 1e-6)):
        true = solution.reflection(np.cos(about[1]), np.cos(about[0]), about[2])
        compare(asset.surface.reflectance(*about)[1], true, about, rounding)
    assert asset.surface.table()[1].largest < 5e-3


# 2 % of the first ask for 54 moments, 12 s of a core
@pytest.mark.slow
@pytest.mark.parametrize("on_top, tolerance", [(0.0, 0.08), (0.3, 0.02)])
def test_facets_between_layers(soil, on_top, tolerance):
    """Those of the recipe below, of a larger index and of a smaller one than what lies on it: the solver's values, and light
    that spreads through them."""
    options = (f"{{thickness: 0.2 mm, boundary: {{index: 1.4, roughness: {on_top}}}, base: {{recipe: rough.yaml}}, "
               f"tolerance: {tolerance}}}")
    (soil / "rough.yaml").write_text(SOIL.replace("{index: 1.2}", "{index: 1.2, roughness: 0.4}"))
    (soil / "varnish.yaml").write_text(RECIPE.replace("{options}", options))
    asset, base = bakery.bake(soil / "varnish.yaml", output=soil / "varnish.h5", overwrite=True), bakery.open(soil / "soil.h5")
    assert not list(surface.check(asset.tree["surface"]))
    lower = Slab(np.asarray(base.medium.theta), np.asarray(base.medium["phase"][2]), 0.9, 1.0, 1.2, 0.2, 0.4)
    slab = Slab(np.asarray(asset.medium.theta), np.asarray(asset.medium["phase"][1]), 0.9, 0.2, 1.4, None, on_top, lower)
    count = int(asset.surface.moments)
    solution = solve(slab, [moments(part.theta, part.phase, count + 1) for part in (slab, lower)], count, tolerance)
    at = THETA[:, None], THETA, 1.0
    compare(asset.surface.reflectance(*at)[1], solution.reflection(np.cos(at[1]), np.cos(at[0]), at[2]), at, 0.1 * tolerance)
    assert (asset.surface["mean_square"] > 0).all()


@pytest.mark.slow
def test_another_base_bakes_anew_and_the_same_does_not(soil, tmp_path):
    def actions():
        from bakery.run.bake import planned

        return {step.stage.name: step.action for step in planned(tmp_path / "top.yaml", tmp_path / "top.h5").steps}

    for name in ("top.yaml", "soil.yaml"):
        (tmp_path / name).write_text((soil / name).read_text())
    for _ in range(2):  # the second time as another file, of another minute
        (tmp_path / "soil.h5").unlink(missing_ok=True)
        bakery.bake(tmp_path / "soil.yaml", output=tmp_path / "soil.h5")
        bakery.bake(tmp_path / "top.yaml", output=tmp_path / "top.h5")
        assert actions()["surface"] == "reuse"
    bakery.bake(tmp_path / "soil.yaml", output=tmp_path / "soil.h5", settings={"surface.base.albedo": "0.1"}, overwrite=True)
    assert actions() == {"medium": "reuse", "surface": "run"}


@pytest.mark.parametrize("options, says", [
    ("{thickness: 1 mm, base: {asset: none.h5}}", "no such file"),
    ("{thickness: 1 mm, base: {asset: soil.yaml}}", "a recipe; expected an asset .* or recipe: soil.yaml"),
    ("{thickness: 1 mm, base: {recipe: soil.h5}}", "an asset; expected a recipe .* or asset: soil.h5"),
    ("{thickness: 1 mm, base: {asset: soil.h5, layer: 2}}", "layer 2 of .*, which has 2; expected 0 to 1"),
    ("{thickness: 1 mm, base: {asset: soil.h5, albedo: 0.1}}", "one of albedo, asset, recipe"),
    ("{thickness: 1 mm, base: {layer: 1}}", "one of albedo, asset, recipe"),
    ("{thickness: 1 mm, base: {albedo: 0.5, layer: 1}}", "layer beside albedo"),
    ("{thickness: 1 mm, boundary: {index: 0.9}, base: {asset: soil.h5}}", "index of 0.9 .*; expected 1 or more"),
    ("{thickness: 1 mm, boundary: {index: 1.3, roughness: 0.2}, base: {recipe: open.yaml}}", "layers over air"),
    ("{thickness: 1 mm, base: {recipe: self.yaml}}", "leads back to this recipe"),
    ("{thickness: 1 mm, base: {recipe: wrong.yaml}}", "wrong.yaml:5: .*albedo"),
    ("{thickness: 1 mm, base: {recipe: red.yaml}}", "at 0.7 um, without 0.45, 0.65 um"),
    ("{base: {recipe: soil.yaml}}", "base under an infinite layer"),
])
def test_bases_that_are_refused(soil, options, says):
    (soil / "wrong.yaml").write_text(SOIL.replace("0.5, 0.6, 0.9", "0.5, 0.6, 1.9"))
    (soil / "red.yaml").write_text(SOIL.replace("[0.45, 0.55, 0.65]", "[0.7]").replace("[0.5, 0.6, 0.9]", "0.5")
                                   .replace("[0.3, 0.3, 0.2]", "0.3"))
    (soil / "open.yaml").write_text(RECIPE.replace("{options}", "{thickness: 1 mm}"))
    (soil / "self.yaml").write_text(RECIPE.replace("{options}", options))
    with pytest.raises(RecipeError, match=says):
        load(soil / "self.yaml")


@pytest.mark.parametrize("name, options", [("soil", {}), ("milk_jug", {}), ("fog", {"surface": "{}"})])
def test_moments_that_a_plan_expects(name, options):
    """Of a lobe those that leave less than the tolerance in its peak; of droplets three a size parameter."""
    recipe = load(ROOT / "recipes" / f"{name}.yaml", options)
    expected = {"soil": math.log(0.006, 0.2), "milk_jug": math.log(0.006, 0.7), "fog": 303}[name]
    assert recipe.surface.tolerance == 0.01
    assert costs.moments(recipe) == pytest.approx(expected, rel=0.15, abs=1)
    assert surface.cost(recipe).file > 2 * costs.expected(recipe).file > 0


def test_walks_that_a_plan_expects(tmp_path):
    """Light crosses a thin layer in a few flights: of more depth a plan expects more, up to what it does of any."""
    def expected(thickness, medium="mean_free_path: 1 mm"):
        recipe = RECIPE.replace("mean_free_path: 1 mm", medium).replace("{options}", f"{{thickness: {thickness}}}")
        (tmp_path / "layer.yaml").write_text(recipe)
        return costs.walks(load(tmp_path / "layer.yaml"))

    thin, thick, deepest = (expected(f"{mm} mm") for mm in (1, 30, 1e6))
    assert 4 * thin < thick < deepest == expected("1e9 mm")
    assert expected('"[1, 30] mm"') == pytest.approx((thin + thick) / 2)
    assert expected("30 mm", "mean_free_path: 30 mm") == pytest.approx(thin)
