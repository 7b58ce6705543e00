"""Stage `multiple`: tables against independent solutions, what the asset gives, and the extremes."""

import math

import numpy as np
import pytest

import bakery
from bakery.errors import RecipeError, StageError
from bakery.recipe import load
from bakery.stages import conform
from bakery.stages.multiple import stage as multiple

RECIPE = """\
bakery: 1
name: cloud
wavelengths: {wavelengths}
tolerance: {tolerance}
medium:
  albedo: {albedo}
  mean_free_path: 1 mm
  phase: {phase}
multiple_scattering: {options}
"""


@pytest.fixture
def bake(tmp_path):
    def run(albedo=0.9, phase="{type: hg, g: 0.7}", options="{extent: 12}", tolerance="1%", wavelengths="[0.55]"):
        path = tmp_path / "cloud.yaml"
        path.write_text(RECIPE.format(albedo=albedo, phase=phase, options=options, tolerance=tolerance, wavelengths=wavelengths))
        return bakery.open(bakery.bake(path, output=tmp_path / "cloud.h5"))

    return run


def test_published_lobes(bake):
    """An independent deterministic solution, good to 1e-4 (small values 1e-3), at 0, 45, 90 and 180 degrees."""
    asset = bake(options="{extent: 12, tolerance: 0.3%}")
    assert 0 < asset.multiple.attributes["achieved_error"] <= asset.multiple.attributes["tolerance"] == 0.003
    theta = np.radians([0, 45, 90, 180])
    for source, rho, z, expected in (
        (asset.multiple.point, 1, 1, (4.549e-3, 2.7584e-2, 1.0639e-2, 1.632e-3)),
        (asset.multiple.point, 1, 3, (7.294e-3, 7.863e-3, 2.132e-3, 5.956e-4)),
        (asset.multiple.point, 5, 5, (1.5151e-4, 3.6372e-4, 2.4994e-4, 5.8326e-5)),
        (asset.multiple.point, 3, -1, (1.1447e-4, 2.2428e-4, 7.1219e-4, 3.5739e-4)),
        (asset.multiple.segment, 1, 1, (1.7156e-3, 9.7195e-3, 9.935e-3, 1.5540e-3)),
        (asset.multiple.segment, 5, 5, (1.3364e-4, 3.4182e-4, 2.7442e-4, 6.1132e-5)),
    ):
        found = source(rho, z, theta, 0.0)
        assert found.shape == (1, 4)
        assert np.abs(found[0] - expected).max() < 0.01 * max(expected), (source, rho, z, found)
        assert np.abs(found[0] / expected - 1).max() < 0.03
    # two segments after each other are one of twice the length
    both = asset.multiple.segment(2.0, 3.0, theta, 0.4) + math.exp(-2) * asset.multiple.segment(2.0, 1.0, theta, 0.4)
    assert asset.multiple.segment(2.0, 3.0, theta, 0.4, length=4.0) == pytest.approx(both, rel=0.02)
    with pytest.raises(ValueError, match="length 2 of a point source"):
        asset.multiple.point(1, 1, 0, 0, length=2)


@pytest.mark.slow
def test_a_tolerance_means_the_same_written_or_left_out(bake):
    """Byte by byte; another tolerance makes other tables."""
    tables = [bake(options=f"{{extent: 4, sources: [segment]{options}}}", tolerance="10%").tree["multiple/segment/w0"]
              for options in ("", ", tolerance: 10%", ", tolerance: 3%")]
    with pytest.raises(AttributeError, match=r"bake it with multiple_scattering: \{sources: \[point, segment\]\}"):
        _ = bake(options="{extent: 4, sources: [segment]}", tolerance="10%").multiple.point
    derived, written, finer = ({name: member.data.tobytes() for name, member in table.members.items()} for table in tables)
    assert derived == written and derived != finer


def test_isotropic_media_keep_their_energy(bake):
    """Light of third and later events: albedo^3/(1 - albedo) of it, whatever the colour; a table a wavelength."""
    albedo = np.array([0.95, 0.5, 0.01])
    asset = bake(albedo="[0.95, 0.5, 0.01]", phase="{type: isotropic}", options="{}", wavelengths="rgb")
    r = np.geomspace(1e-3, 60, 1500)
    shells = 4 * np.pi * asset.multiple.point(r, 0.0, 0.3, 0.1) * 4 * np.pi * r**2
    assert np.trapezoid(shells, r, axis=1) == pytest.approx(albedo**3 / (1 - albedo), rel=5e-3)
    assert asset.multiple.point(1.0, 0.0, 0.0, 0.0)[1] * 4 * np.pi == pytest.approx(7.35506e-3, rel=5e-3)


def test_nothing_that_scatters_is_an_empty_table(bake):
    asset = bake(albedo="[0.5, 0]", wavelengths="[0.45, 0.65]", phase="{type: isotropic}")
    values = asset.multiple.point([0.5, 1.0], 1.0, 0.2, 0.3)
    assert (values[0] > 0).all() and (values[1] == 0).all() and (asset.multiple.segment(1.0, 1.0, 0.2, 0.3)[1] == 0).all()
    assert "0.65 um: nothing is scattered" in asset.provenance.multiple.notes


def test_at_the_source_and_far_away_answers_are_finite(bake):
    asset = bake(tolerance="10%")
    for source in (asset.multiple.point, asset.multiple.segment):
        for rho, z in ((0, 0), (0, 1), (1e-12, 2), (0, 1e4), (1e4, -1e4)):
            value = source(rho, z, [0.0, 1.0, math.pi], 0.0)
            assert np.isfinite(value).all() and (value >= 0).all(), (source, rho, z)


def test_peaks_count_as_not_scattered(bake, tmp_path):
    """A narrow peak is taken out with the sigma_t that it stands for: the medium without it has the same light."""
    theta = np.concatenate([[0, 1e-3], np.linspace(0.02, math.pi, 400)])
    g, share = 0.3, 0.4
    smooth = (1 - g * g) / (4 * math.pi * (1 + g * g - 2 * g * np.cos(theta)) ** 1.5)
    peak = share / (1 - share) * np.where(theta == 0, 2 / (math.pi * 1e-6), 0.0)
    rows = "\n".join(f"{t!r},{v!r}" for t, v in zip(theta.tolist(), (smooth + peak).tolist()))
    (tmp_path / "peak.csv").write_text(f"theta_rad,value\n{rows}\n")
    with_peak = bake(albedo=0.9, phase="{type: table, file: peak.csv}", options="{extent: 12, orders: 24}")
    stretch = 1 - 0.9 * share
    assert with_peak.multiple.extinction == pytest.approx([stretch], rel=0.01)
    plain = bake(albedo=0.9 * (1 - share) / stretch, phase=f"{{type: hg, g: {g}}}")
    at = np.array([0.5, 1.0, 3.0])
    expected = plain.multiple.point(at * stretch, at * stretch, 0.8, 0.5) * stretch**3
    assert with_peak.multiple.point(at, at, 0.8, 0.5) == pytest.approx(expected, rel=0.02)
    assert "delta-M" in with_peak.provenance.multiple.notes


def test_plans_know_that_photons_stand_in(tmp_path):
    """Where the solver refuses a backward peak: as for method: photons, a wavelength each, and more for segments."""
    def cost(g, options):
        (tmp_path / "cloud.yaml").write_text(RECIPE.format(albedo=0.9, phase=f"{{type: hg, g: {g}}}", options=options,
                                                           tolerance="1%", wavelengths="[0.5, 0.6]"))
        return multiple.cost(load(tmp_path / "cloud.yaml"))

    solved, refused, asked = (cost(*words) for words in ((-0.9, "{}"), (-0.99, "{}"), (0.0, "{method: photons}")))
    assert solved.kind == "solver" and refused == asked and refused.kind == "photons" and refused.seconds > 3 * solved.seconds
    assert cost("[0.9, -0.99]", "{}").seconds == refused.seconds / 2
    assert cost(-0.99, "{sources: [point]}").seconds < refused.seconds
    assert cost(-0.99, "{photons: 3200}").seconds < 0.7 * refused.seconds
    assert cost(-0.99, "{method: solver}").kind == "solver"


@pytest.mark.slow
def test_what_no_solver_reaches_is_refused_or_left_to_photons(bake, tmp_path):
    with pytest.raises(StageError, match="wavelength number 0: the phase function has a narrow peak backward"):
        bake(phase="{type: hg, g: -0.999}", options="{method: solver}")
    with pytest.raises(StageError, match="is written, but .* more multiple_scattering.photons would do"):
        bake(phase="{type: hg, g: -0.95}", options="{sources: [point], extent: 3, orders: 8, photons: 3200, tolerance: 10%}")
    asset = bakery.open(tmp_path / "cloud.h5")
    assert "made of 3200 photons; wavelength number 0" in asset.provenance.multiple.notes
    assert "a cone of 5.7 degrees" in asset.provenance.multiple.notes
    place = asset.multiple["point/w0"]
    assert place["resolution"] == 0.1 and place["photons"] == 3200
    assert place["offset_error"].shape == place["offset"].shape and (place["offset_error"] > 0).all()
    assert asset.multiple.point(0.5, 0.5, 1.0, 0.0) > 0


@pytest.mark.slow
def test_photons_check_the_solver(bake):
    """The same recipe by both methods: within what both state."""
    made = [bake(options=f"{{method: {method}, sources: [point], extent: 12, tolerance: 10%}}")
            for method in ("solver", "photons, photons: 60000")]
    assert "photons" in made[1].multiple["point/w0"] and "photons" not in made[0].multiple["point/w0"]
    stated = sum(asset.multiple.attributes["achieved_error"] for asset in made)
    assert multiple.measures(*(asset.tree["multiple"] for asset in made))["error"] < stated < 0.11
    assert not list(multiple.check(made[1].tree["multiple"]))


@pytest.mark.parametrize(("options", "said"), [
    ("{sources: [point, point]}", "found a source twice"), ("{extent: 1000}", "at most 200"), ("{length: 0}", "at least 0.1"),
    ("{sources: [line]}", "point or segment"), ("{method: rays}", "auto, solver or photons"),
    ("{method: solver, photons: 5000}", "photons beside method: solver"), ("{lobes: 4}", "unknown key")])
def test_bad_options(tmp_path, options, said):
    path = tmp_path / "cloud.yaml"
    path.write_text(RECIPE.format(albedo=0.9, phase="{type: isotropic}", options=options, tolerance="1%", wavelengths="[0.55]"))
    with pytest.raises(RecipeError, match=said):
        load(path)


def test_rules_find_what_is_wrong(bake):
    asset = bake(tolerance="10%", phase="{type: isotropic}")
    group = asset.tree["multiple"]
    assert not list(multiple.check(group))
    from bakery.store.tree import Dataset, Group

    place = group["point/w0"]
    corner = place["corner"]
    cut = Group({**place.members, "corner": Dataset(corner.data[:-1], corner.units, corner.description)})
    broken = Group({**group.members, "point": Group({**group["point"].members, "w0": cut})})
    assert any("point/w0" in fault for fault in conform.broken(multiple.STAGE, broken))
    assert multiple.measures(group, group)["error"] == 0
