"""`bake export --to disort`: what the file holds, and the real solvers on it against the baked surface and against Mitsuba."""

import json
import math

import numpy as np
import pytest

from bakery.physics.medium.lobes import Lobes
from bakery.physics.medium.phase import phase_at, phase_integral, with_delta
from bakery.physics.moments import phase_of
from bakery.physics.surfaces.refine import converged
from bakery.physics.surfaces.slab import Slab
from bakery.store.tree import Dataset
from bakery.store.write import write
from tests.samples import small_asset, with_member
from tests.slab import SIGMA_A, SIGMA_S, in_mitsuba, medium_of_lobes

NO_PACKAGE = "is not installed (extra `solvers`)"

CLOUD = """\
bakery: 1
name: cloud
wavelengths: [0.55]
tolerance: 0.1%
medium: {sigma_s: 0.02 /m, sigma_a: 2e-5 /m, phase: {type: hg, g: 0.75}}
surface: {thickness: "[50, 500] m", tolerance: 0.02%}
"""
DROPLETS = """\
bakery: 1
name: droplets
wavelengths: [0.55]
tolerance: 1%
particles:
  host: air
  number_density: 1e8 /m^3
  components:
    - name: droplets
      material: water
      size: {distribution: gamma, radius: 4 um, variance: 0.1, max: 25 um}
surface: {thickness: "[200, 1000] m", tolerance: 2%}
"""
OUT, AZIMUTH = np.radians([10, 45, 70])[:, None], np.array([0.0, 1.0, 2.5])


@pytest.fixture
def exported(call, tmp_path):
    """Export a tree; the arrays of its file, the report, and what was said."""
    def run(tree, *options):
        write(tmp_path / "fog.h5", tree)
        status, out, err = call("export", tmp_path / "fog.h5", "--to", "disort", "--json", "--overwrite", *options)
        assert status == 0, err
        report = json.loads(out)
        with np.load(report["files"][0], allow_pickle=False) as file:
            return dict(file), report, err

    return run


@pytest.fixture
def baked(call, tmp_path):
    """Bake a recipe and export it: the asset, and the arrays of the file."""
    def run(recipe, thickness):
        import bakery

        (tmp_path / "a.yaml").write_text(recipe)
        for arguments in ((tmp_path / "a.yaml", "-o", tmp_path / "a.h5"),
                          ("export", tmp_path / "a.h5", "--to", "disort", "--thickness", thickness, "-o", tmp_path)):
            status, _, err = call(*arguments)
            assert status == 0, err
        return bakery.open(tmp_path / "a.h5"), np.load(tmp_path / "a.npz")

    return run


def test_the_file_holds_the_medium(exported):
    tree = small_asset()
    cloud, report, err = exported(tree, "--thickness", "[2, 500] mm")
    medium = tree["medium"]
    assert report["warnings"] == [] and err == ""
    np.testing.assert_array_equal(cloud["wavelength"], [0.61, 0.465])
    np.testing.assert_array_equal(cloud["sigma_t"], medium["sigma_t"].data)
    np.testing.assert_allclose(cloud["omega"], medium["albedo"].data, rtol=1e-15)
    np.testing.assert_allclose(cloud["tau"], np.outer(medium["sigma_t"].data, [0.002, 0.5]), rtol=1e-15)
    assert (cloud["moments"][:, 0] == 1).all() and cloud["moments"].shape[1] >= 129
    # of Henyey and Greenstein's function, off by what a table of 400 angles is
    np.testing.assert_allclose(cloud["moments"][0, :9], 0.8 ** np.arange(9), atol=2e-3)
    np.testing.assert_allclose(cloud["moments"][:, 1], medium["g"].data, rtol=1e-12)
    # the whole phase function goes with them
    np.testing.assert_allclose(np.trapezoid(cloud["phase"], cloud["mu"]), 2, rtol=1e-9)
    np.testing.assert_allclose(cloud["phase"][:, ::-1], 4 * math.pi * medium["phase"].data, rtol=1e-15)


@pytest.mark.parametrize("orders", [2, 8, 40])
def test_what_is_cut_is_stated(exported, orders):
    """The integral of what a series misses, and the warning says how much that is."""
    tree = small_asset()
    cloud, report, _ = exported(tree, "--moments", str(orders))
    theta, phase = tree["medium/theta"].data, tree["medium/phase"].data
    fine = np.union1d(theta, np.linspace(0, math.pi, 20001))
    missed = phase_integral(fine, np.abs(phase_at(theta, phase, fine) - phase_of(cloud["moments"][:, :orders + 1], fine)))
    np.testing.assert_allclose(cloud["cut"], missed, rtol=0.05)
    assert [lost["cut"] for lost in report["lost"]] == cloud["cut"].tolist()
    assert bool(report["warnings"]) == (cloud["cut"].max() > 0.01)


def test_unscattered_light_is_taken_out(exported):
    """A medium with a forward delta and the same one without are one file, but for rounding."""
    tree, share = small_asset(), np.array([0.3, 0.0])
    medium = tree["medium"]
    sigma_s, sigma_a, theta = (medium[name].data for name in ("sigma_s", "sigma_a", "theta"))
    plain, _, _ = exported(tree)
    more = sigma_s / (1 - share)
    values = {"sigma_s": more, "sigma_t": more + sigma_a, "albedo": more / (more + sigma_a), "forward_delta": share}
    for name, value in values.items():
        tree = with_member(tree, f"medium/{name}", Dataset(value, "1/m" if name.startswith("sigma") else "1", name))
    peaked = with_member(tree, "medium/phase", Dataset(with_delta(theta, medium["phase"].data, share), "1/sr", "phase"))
    (there, _, _) = exported(peaked)
    for name in ("sigma_t", "omega", "moments"):
        np.testing.assert_allclose(there[name], plain[name], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(("options", "words"), [
    (("--thickness", "3"), "--thickness: found \"3\", which has no unit"),
    (("--thickness", "[1, -3] m"), "--thickness: found \"[1, -3] m\"; expected lengths of 0 or more"),
    (("--moments", "0"), "--moments: found \"0\"; expected the highest order"),
    (("--moments", "many"), "--moments: found \"many\""),
    (("--moments", "100000"), "a whole number from 1 to 4096")])
def test_wrong_options(call, tmp_path, options, words):
    write(tmp_path / "a.h5", small_asset())
    status, out, err = call("export", tmp_path / "a.h5", "--to", "disort", *options)
    assert status == 2 and not out and words in err


# ---- the solvers


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::UserWarning")  # PythonicDISORT's remarks on streams and albedos near 1
@pytest.mark.parametrize(("recipe", "peak", "thickness", "streams", "radiance", "flux"), [
    (CLOUD, "none", "[50, 500] m", 64, 2e-3, 1e-6),  # half of the radiance's is the solver's: 5e-4 with twice the streams
    (DROPLETS, "narrow", "[200, 1000] m", 128, 2e-3, 1e-6)])
def test_pythonicdisort_and_the_baked_surface_agree(baked, recipe, peak, thickness, streams, radiance, flux):
    """Radiance above and below a cloud at nine directions each, two incidences and two thicknesses, and fluxes."""
    pydisort = pytest.importorskip("PythonicDISORT", reason=f"PythonicDISORT {NO_PACKAGE}").pydisort
    from PythonicDISORT.subroutines import interpolate

    asset, cloud = baked(recipe, thickness)
    for t, degrees in ((0, 30), (0, 60), (1, 30), (1, 60)):
        theta, mu0, tau = math.radians(degrees), math.cos(math.radians(degrees)), cloud["tau"][0, t]
        _, up, down, *_, u = pydisort(tau, cloud["omega"][0], streams, cloud["moments"][0], mu0, 1, 0, NLeg=streams,
                                      f_arr=cloud["moments"][0, streams], NT_cor=True)
        at = interpolate(u)
        for depth, side, ours in ((0, 1, asset.surface.reflectance), (tau, -1, asset.surface.transmittance)):
            theirs = math.pi / mu0 * at(side * np.cos(OUT[:, 0]), depth, AZIMUTH).squeeze()
            # in the aureole of a peak the surface counts light that it deflects several times as if once (docs/surface.md)
            beside = slice(None) if peak == "none" or side > 0 else slice(1, None)
            np.testing.assert_allclose(ours(theta, OUT, AZIMUTH)[0, t][:, beside], theirs[:, beside], rtol=radiance)
        assert asset.surface.albedo(theta)[0, t] * mu0 == pytest.approx(float(up(0)), rel=flux)
        assert mu0 - sum(map(float, down(tau))) - float(up(0)) >= -1e-6  # no light is made


@pytest.mark.slow
def test_nanodisort_and_the_baked_surface_agree(baked):
    """cdisort corrects single scattering by the phase function itself, as the surface does: its solution has eight digits.

    What is stored is rounded within the tolerance: 0.01 % at the worst of all angles, by its `change`, a tenth of that here."""
    solver = pytest.importorskip("nanodisort", reason=f"nanodisort {NO_PACKAGE}")
    asset, cloud = baked(CLOUD, "500 m")
    mu0, streams = math.cos(math.radians(60)), 64
    state = solver.DisortState()
    state.nlyr, state.nstr, state.nmom, state.nphase = 1, streams, cloud["moments"].shape[1] - 1, cloud["mu"].size
    state.ntau, state.numu, state.nphi = 1, OUT.size, AZIMUTH.size
    state.usrtau = state.usrang = state.lamber = state.quiet = state.intensity_correction = True
    state.planck = state.onlyfl = state.old_intensity_correction = False
    state.allocate()
    state.dtauc, state.ssalb, state.utau = cloud["tau"][:1], cloud["omega"][:1], np.zeros(1)
    state.pmom = np.ascontiguousarray(cloud["moments"][0][:, None])
    state.mu_phase, state.phase = np.ascontiguousarray(cloud["mu"][::-1]), np.ascontiguousarray(cloud["phase"][:1, ::-1])
    state.fbeam, state.umu0, state.phi0, state.albedo, state.fisot, state.accur = 1.0, mu0, 0.0, 0.0, 0.0, 0.0
    state.umu, state.phi = np.cos(OUT[::-1, 0]), np.degrees(AZIMUTH)
    state.solve()
    theirs = math.pi / mu0 * np.array(state.uu)[::-1, 0]
    slab = Slab(np.arccos(cloud["mu"][::-1]), cloud["phase"][0, ::-1] / (4 * math.pi), cloud["omega"][0], float(cloud["tau"][0]))
    solution, _ = converged(slab, 2e-4)
    np.testing.assert_allclose(solution.reflection(*np.broadcast_arrays(np.cos(OUT), mu0, AZIMUTH)), theirs, rtol=1e-8)
    np.testing.assert_allclose(asset.surface.reflectance(math.acos(mu0), OUT, AZIMUTH)[0, 1], theirs, rtol=2e-5)
    assert asset.surface.albedo(math.acos(mu0))[0, 1] * mu0 == pytest.approx(state.flup[0], rel=1e-7)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("degrees", [30, 140])
def test_pythonicdisort_and_mitsuba_agree(call, tmp_path, degrees):
    """A slab by `volpath` with the asset's phase function: light that goes on by 30 degrees through it, and back by 140.

    Bounds are 5.5 standard errors (of 4 numbers: a false alarm once in 6 million), and 0.3 % for the slab's edges, 10 m off.
    """
    pydisort = pytest.importorskip("PythonicDISORT", reason=f"PythonicDISORT {NO_PACKAGE}").pydisort
    from PythonicDISORT.subroutines import interpolate

    path, angle = tmp_path / "slab.h5", math.radians(degrees)
    write(path, medium_of_lobes(Lobes((1.0,), (0.7,), (0.0,))))
    assert call("export", path, "--to", "disort", "--thickness", "1 m", "-o", tmp_path)[0] == 0
    slab, mu0 = np.load(tmp_path / "slab.npz"), abs(math.cos(angle))
    through, expected = degrees < 90, []
    for i in (0, 1):
        *_, u = pydisort(slab["tau"][i], slab["omega"][i], 32, slab["moments"][i], mu0, 1, 0, NLeg=32,
                         f_arr=slab["moments"][i, 32], NT_cor=True)
        # the interpolation in mu does not know that odd orders end as a root at the normal, where all but the first vanish
        azimuths = np.linspace(0, 2 * math.pi, 16, endpoint=False)
        there = interpolate(u)(-1.0 if through else 1.0, slab["tau"][i] if through else 0.0, azimuths)
        expected.append(float(np.mean(there)))
    both = np.array([0, 1, 1])
    found, error = in_mitsuba(path, SIGMA_S[both], (SIGMA_S + SIGMA_A)[both], angle)
    assert np.all(np.abs(found - np.array(expected)[both]) < 5.5 * error + 0.003 * found) and np.all(error < 0.02 * found)
