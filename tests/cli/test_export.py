"""`bake export`: tables that hold every number, and a phase function for stock Mitsuba whose loss is what it says."""

import contextlib
import csv
import io
import itertools
import json
import math
import os
from xml.etree import ElementTree

import numpy as np
import pytest
from scipy.integrate import quad

from bakery.physics.medium.phase import cumulative, mean_cosine, normalised, phase_at
from bakery.physics.medium.regular import adaptive_table, loss, regular_table
from bakery.store.tree import Dataset, text
from bakery.store.write import write
from tests.conftest import ROOT
from tests.samples import small_asset, with_member


def henyey_greenstein(g: float, angles: int = 4000):
    """A table of Henyey and Greenstein's phase function, normalised as baked ones are."""
    theta = np.concatenate([[0.0], np.geomspace(1e-6, math.pi, angles)])
    theta[-1] = math.pi
    v = 2 * np.sin(theta / 2) ** 2
    return theta, normalised(theta, (1 - g * g) / ((1 - g) ** 2 + 2 * g * v) ** 1.5)[0]


def integral(values):
    """2 pi times the integral over the cosine of a regular table, by the trapezoid, which is exact for it."""
    return 2 * math.pi * np.trapezoid(values, np.linspace(-1, 1, len(values)))


def mean(values):
    """Mean cosine of a regular table, exact for its interpolant (Simpson on each cell)."""
    mu, step = np.linspace(-1, 1, len(values)), 2 / (len(values) - 1)
    middle = (values[1:] + values[:-1]) * (mu[1:] + mu[:-1])
    return 2 * math.pi * step / 6 * np.sum(values[:-1] * mu[:-1] + middle + values[1:] * mu[1:])


@pytest.mark.parametrize("g", [-0.9, 0.0, 0.7, 0.99, 0.9999])
@pytest.mark.parametrize("count", [2, 3, 65, 4097])
def test_the_grid_keeps_the_integral_and_nearly_the_mean_cosine(g, count):
    theta, phase = henyey_greenstein(g)
    values = regular_table(theta, phase, count)
    assert (values > 0).all()
    # rounding only: sums of up to 8000 terms
    assert integral(values) == pytest.approx(1, abs=1e-11)
    # the bound that the docstring states: a third of a cell times the light in the two end halves of a cell
    edge = 2 * math.pi * (values[0] + values[-1]) / (count - 1)
    assert abs(mean(values) - mean_cosine(theta, phase)) <= edge * 2 / (count - 1) / 3 + 1e-11


def test_loss_is_what_brute_force_finds():
    theta, phase = henyey_greenstein(0.9, 300)
    values = regular_table(theta, phase, 65)
    found = loss(theta, phase, values)

    def table(angle):
        return np.interp(math.cos(angle), np.linspace(-1, 1, 65), values)

    def source(angle):
        return float(phase_at(theta, phase, angle))

    points = np.union1d(theta, np.arccos(np.linspace(-1, 1, 65)))
    difference = sum(quad(lambda t: abs(table(t) - source(t)) * math.sin(t), a, b)[0] for a, b in itertools.pairwise(points))
    assert found.misdirected == pytest.approx(math.pi * difference, rel=1e-4)  # kinks inside a piece limit the quadrature
    assert found.g == pytest.approx(mean(values) - mean_cosine(theta, phase), abs=1e-12)
    relative = [abs(table(t) / p - 1) for t, p in zip(theta, phase, strict=True)]
    assert found.largest == pytest.approx(max(relative), rel=1e-9) and found.largest_at == theta[np.argmax(relative)]
    inside = points[points <= found.peak_angle + 1e-12]

    def light(f):
        return sum(quad(lambda t: f(t) * math.sin(t), a, b)[0] for a, b in itertools.pairwise(inside))

    assert source(found.peak_angle) < 0.5 * source(0) and found.peak == pytest.approx(1 - light(table) / light(source), rel=1e-6)


def test_the_table_is_as_long_as_it_must_be():
    lengths = {}
    for g in (0.0, 0.7, 0.95):
        theta, phase = henyey_greenstein(g)
        values, lost = adaptive_table(theta, phase, 1e-3)
        assert lost.misdirected <= 1e-3 and values.dtype == np.float32
        lengths[g] = len(values)
        if len(values) > 65:  # half as many would not do
            assert loss(theta, phase, regular_table(theta, phase, (len(values) + 1) // 2)).misdirected > 1e-3
    assert lengths[0.0] == 65 < lengths[0.7] < lengths[0.95]


def test_what_no_table_can_hold_is_stated():
    theta, phase = henyey_greenstein(0.99999)
    values, lost = adaptive_table(theta, phase, 1e-3, largest=14)
    assert len(values) == 2**14 + 1 and lost.misdirected > 0.1 and lost.peak > 0.9


@pytest.fixture(scope="module")
def root():
    return small_asset()


@pytest.fixture(scope="module")
def fog(tmp_path_factory, root):
    path = tmp_path_factory.mktemp("export") / "fog.h5"
    write(path, root)
    return path


def test_csv_holds_every_number(call, fog, root, tmp_path):
    status, out, err = call("export", fog, "--to", "csv", "-o", tmp_path / "t")
    assert status == 0 and "nothing is lost" in err
    assert sorted(out.splitlines()) == sorted(str(path) for path in (tmp_path / "t").iterdir())
    found = {}
    for path in (tmp_path / "t").glob("*.csv"):
        with open(path, newline="") as file:
            head, *rows = csv.reader(file)
        for name, column in zip(head, zip(*rows, strict=True), strict=True):
            found[f"{path.stem.removeprefix('fog_')}: {name}"] = column
    rows_of = {"A": "theta", "R": "radius", "L": "wavelength"}
    held = 0
    for path, member in root.walk():
        group, _, name = path.rpartition("/")
        if group not in ("optics/droplets", "medium") or not isinstance(member, Dataset) or name == "mean_volume":
            continue
        by = {2: "L", 60: "R"}.get(member.data.shape[-1], "A")
        columns = [(f"{name} at {um:g} um", row) for um, row in zip((0.61, 0.465), member.data, strict=True)] \
            if member.data.ndim == 2 else [(name, member.data)]
        for heading, values in columns:
            column = found[f"{group.replace('/', '_')}_by_{rows_of[by]}: {heading} [{member.units}]"]
            assert list(column) == ["mie"] * 60 if name == "method" else np.array_equal(np.array(column, float), values), heading
            held += 1
    (volume,) = found["optics_droplets_mean_volume: mean_volume [um^3]"]
    assert held > 20 and float(volume) == root["optics/droplets/mean_volume"].data[0]
    assert (tmp_path / "t" / "fog_recipe.yaml").read_bytes() == root["recipe"].data.tobytes()
    assert found["stages: achieved_error"] == ("0.004", "0.004")


def test_mitsuba_fragment(call, fog, root, tmp_path):
    status, out, _ = call("export", fog, "--to", "mitsuba", "-o", tmp_path, "--json")
    report = json.loads(out)
    assert status == 0 and report["files"] == [str(tmp_path / "fog.xml")]
    tree = ElementTree.parse(tmp_path / "fog.xml").getroot()
    medium = tree.find("medium")
    assert tree.get("version") == "3.0.0" and medium.get("type") == "homogeneous" and medium.get("id") == "fog"
    values = np.array(medium.find("phase/string").get("value").split(","), float)
    assert len(values) == report["lost"][0]["values"]
    # -1 first: the forward peak stands at the end
    assert values[-1] > 100 * values[0] and integral(values) == pytest.approx(1, abs=1e-6)
    sigma_s, phase = root["medium/sigma_s"].data, root["medium/phase"].data
    mixture = sigma_s @ phase / sigma_s.sum()
    # the text gives back every single-precision number
    assert np.array_equal(values.astype(np.float32), adaptive_table(root["medium/theta"].data, mixture)[0])
    lost = loss(root["medium/theta"].data, mixture, values.astype(np.float32))
    stated = report["lost"][0]["resampling"]
    assert stated["misdirected"] == pytest.approx(lost.misdirected, rel=1e-9) and stated["misdirected"] <= 1e-3
    assert [row["wavelength_um"] for row in report["lost"][0]["wavelengths"]] == [0.61, 0.465]
    g = root["medium/g"].data
    for row, own in zip(report["lost"][0]["wavelengths"], g, strict=True):
        assert row["g"] == pytest.approx(sigma_s @ g / sigma_s.sum() - own, abs=1e-5)
    status, out, said = call("export", fog, "--to", "mitsuba", "-o", tmp_path)
    assert out == f"{tmp_path / 'fog.xml'}\n"
    assert all(word in said for word in ("mean error", "largest error", "error of g", "forward peak cut", "at 0.465 um"))


def test_stock_mitsuba_loads_it(call, fog, root, tmp_path):
    """Mitsuba's own numbers: sigma_t, albedo, the phase function at angles, g of its samples."""
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    assert call("export", fog, "--to", "mitsuba", "-o", tmp_path, "--each-wavelength")[0] == 0
    names = ["fog_610nm", "fog_465nm"]
    assert sorted(path.stem for path in tmp_path.glob("*.xml")) == sorted(names)
    for i, name in enumerate(names):
        (tmp_path / "scene.xml").write_text(
            f'<scene version="3.0.0"><include filename="{name}.xml"/>'
            f'<shape type="cube"><bsdf type="null"/><ref name="interior" id="{name}"/></shape></scene>')
        medium = mi.load_file(str(tmp_path / "scene.xml")).shapes()[0].interior_medium()
        at = mi.MediumInteraction3f()
        at.wi = mi.Vector3f(0, 0, -1)  # light travels along +z
        at.sh_frame = mi.Frame3f(at.wi)
        sigma_s, _, sigma_t = medium.get_scattering_coefficients(at)
        assert float(sigma_t[0]) == pytest.approx(root["medium/sigma_t"].data[i], rel=1e-6)
        assert float(sigma_s[0]) == pytest.approx(root["medium/sigma_s"].data[i], rel=1e-6)
        phase, context = medium.phase_function(), mi.PhaseFunctionContext()
        theta, table = root["medium/theta"].data, root["medium/phase"].data[i]
        for angle in np.radians([5, 20, 60, 120, 175]):
            value, _ = phase.eval_pdf(context, at, mi.Vector3f(math.sin(angle), 0, math.cos(angle)))
            assert float(value[0]) == pytest.approx(phase_at(theta, table, angle), rel=5e-3)
        draw = np.random.default_rng(7).random((20000, 3))
        cosines = [phase.sample(context, at, a, [b, c])[0][2] for a, b, c in draw]
        # 5 standard errors: a false alarm once in 1.7 million
        assert abs(np.mean(cosines) - root["medium/g"].data[i]) < 5 * np.std(cosines) / math.sqrt(len(cosines))


def test_colour_in_stock_mitsuba(call, root, tmp_path):
    """A thick medium of three wavelengths: coefficients above 1 and colours arrive as red, green, blue."""
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    sigma_t = np.array([800.0, 1200.0, 2000.0])
    albedo = np.array([0.9, 0.8, 1.0])
    three = with_member(root, "wavelength", Dataset(np.array([0.465, 0.61, 0.55]), "um", "wavelengths"))
    for name, values in (("sigma_t", sigma_t), ("sigma_s", sigma_t * albedo), ("albedo", albedo)):
        three = with_member(three, f"medium/{name}", Dataset(values, root[f"medium/{name}"].units, name))
    three = with_member(three, "medium/phase", Dataset(root["medium/phase"].data[[0, 0, 0]], "1/sr", "phase"))
    for name, member in root["medium"].members.items():
        if three[f"medium/{name}"].data.shape[0] == 2:
            three = with_member(three, f"medium/{name}", Dataset(member.data[[0, 0, 0]], member.units, name))
    write(tmp_path / "thick.h5", with_member(three, "optics", None))
    assert call("export", tmp_path / "thick.h5", "--to", "mitsuba")[0] == 0
    scene = mi.load_file(str(tmp_path / "thick-mitsuba" / "thick.xml"))
    assert scene is not None
    (tmp_path / "scene.xml").write_text('<scene version="3.0.0"><include filename="thick-mitsuba/thick.xml"/>'
                                        '<shape type="cube"><bsdf type="null"/><ref name="interior" id="fog_thick"/></shape>'
                                        '</scene>')
    medium = mi.load_file(str(tmp_path / "scene.xml")).shapes()[0].interior_medium()
    scattering, _, extinction = medium.get_scattering_coefficients(mi.MediumInteraction3f())
    assert np.allclose(np.array(extinction), sigma_t[[1, 2, 0]], rtol=1e-6)
    assert np.allclose(np.array(scattering), (sigma_t * albedo)[[1, 2, 0]], rtol=1e-6)


@pytest.fixture(scope="module")
def hail(tmp_path_factory, root):
    """Half of the light, 45 % at the second wavelength, in a peak of 1e-4 rad: path, tree, share within half a degree."""
    theta = root["medium/theta"].data
    theta = np.union1d(theta, np.geomspace(1e-6, 0.1, 400))
    broad = phase_at(root["medium/theta"].data, root["medium/phase"].data, theta)
    narrow = normalised(theta, np.exp(-0.5 * (theta / 1e-4) ** 2))[0]
    phase = np.array([[0.5], [0.45]]) * narrow + np.array([[0.5], [0.55]]) * broad
    phase = normalised(theta, phase)[0]
    tree = with_member(root, "optics", None)
    for name, data in {"theta": theta, "phase": phase, "cdf": cumulative(theta, phase), "phase_bias": 0 * phase}.items():
        tree = with_member(tree, f"medium/{name}", Dataset(data, root[f"medium/{name}"].units, name))
    for name in {"s11", "s12", "s33", "s34"} & root["medium"].members.keys():
        tree = with_member(tree, f"medium/{name}", None)
    path = tmp_path_factory.mktemp("hail") / "hail.h5"
    write(path, tree)
    return path, tree, broad


def test_a_peak_that_no_grid_resolves_counts_as_unscattered(call, hail, tmp_path):
    """Most of it: sigma_t and sigma_s lose it, at each wavelength its own share, and the table is right for what remains."""
    path, tree, broad = hail
    status, out, err = call("export", path, "--to", "mitsuba", "-o", tmp_path, "--each-wavelength", "--json")
    report = json.loads(out)
    assert status == 0 and not err and report["warnings"] == []
    sigma_t, sigma_s = (tree[f"medium/{name}"].data for name in ("sigma_t", "sigma_s"))
    for i, (file, lost) in enumerate(zip(report["files"], report["lost"], strict=True)):
        assert os.path.getsize(file) < 2e6 and lost["resampling"]["misdirected"] <= 1e-3
        assert lost["peak"] == pytest.approx((0.5, 0.45)[i], abs=0.005) and 1e-4 < lost["within"] < math.radians(1)
        medium = ElementTree.parse(file).getroot().find("medium")
        scale, extinction = (float(medium.find(f"float[@name='{name}']").get("value")) for name in ("scale", "sigma_t"))
        assert scale * extinction == pytest.approx(sigma_t[i] - lost["peak"] * sigma_s[i], rel=1e-12)
        values = np.array(medium.find("phase/string").get("value").split(","), float)
        side = np.radians([20, 60, 90, 150])
        table = np.interp(np.cos(side), np.linspace(-1, 1, len(values)), values)
        assert np.allclose(table, phase_at(tree["medium/theta"].data, broad[i], side), rtol=0.01)
    said = call("export", path, "--to", "mitsuba", "-o", tmp_path)[2]
    assert "it counts as unscattered" in said and "by that and one table" in said


def test_nearly_useless_fragments_say_so_first():
    from bakery.export.mitsuba import Fragment
    from bakery.physics.medium.regular import Loss

    good, bad = (Loss(share, 1.0, 0.0, 0.0, 0.0, 1.0) for share in (1e-3, 0.4))
    assert not Fragment("", "", 65, good, {0.5: good, 0.6: good}).useless()
    assert "40 % of the light to another angle" in Fragment("", "", 65, bad, {}).useless()
    assert "at 0.6 um" in (said := Fragment("", "", 65, good, {0.5: good, 0.6: bad}).useless()) and "--each-wavelength" in said


def test_fits_of_little_use_are_named_first(call, monkeypatch, tmp_path, fog):
    from bakery.export import hg
    from bakery.physics.medium.lobe_fits import Fit
    from bakery.physics.medium.lobes import Lobes, Misfit

    def row(um, **fits):
        return hg.Row(um, dict.fromkeys(hg.COEFFICIENTS, 1.0),
                      {name: Fit(Lobes((1.0,), (0.5,), (0.0,)), Misfit(share, 0, 0, 0, factor, math.pi / 2, 1, 1, 1))
                       for name, (share, factor) in fits.items()})

    assert hg.useless([row(0.5, hg_g=(0.1, 9.0), hg2=(0.05, 0.2))]) == []
    first, second = hg.useless([row(0.5, hg_g=(0.2, 2.0), hg2=(0.05, 0.5)), row(0.6, hg_g=(0.41, 2.0), hg2=(0.06, 1 / 230))])
    assert "up to 41 %" in first and first.endswith(": HG, exact g")
    assert second == "even the best, two HG, best, is 230 times too dark at 90 deg"
    monkeypatch.setattr(hg, "lobe_rows", lambda *_: [row(um, hg_g=(0.41, 1 / 230)) for um in (0.61, 0.465)])
    status, out, err = call("export", fog, "--to", "hg", "-o", tmp_path)
    assert status == 0 and err.startswith("warning: fog_lobes: of little use") and "/ 230 at 90 deg !" in err


@pytest.fixture(scope="module")
def lobes(tmp_path_factory, root):
    """A small asset whose recipe says that it is water in air, and its lobes: folder, standard output, standard error."""
    from bakery.cli import status_of

    recipe = ("bakery: 1\nparticles:\n  host: air\n  components:\n    - {name: droplets, material: water, "
              "size: {distribution: single, radius: 5 um}}\n")
    folder = tmp_path_factory.mktemp("lobes")
    write(folder / "fog.h5", with_member(root, "recipe", text(recipe, "the recipe's text")))
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        assert status_of(["export", str(folder / "fog.h5"), "--to", "hg"]) == 0
    return folder / "fog-hg", out.getvalue(), err.getvalue()


@pytest.mark.slow
def test_lobes_as_json_tell_what_their_formula_gives(lobes, root):
    """A reader who knows the JSON only: the formula in it, by the trapezoid, misdirects what is stated and has the g stated."""
    folder, _, _ = lobes
    found = json.loads((folder / "fog_lobes.json").read_text())
    assert found["content_hash"] and [row["wavelength"] for row in found["wavelengths"]] == [0.61, 0.465]
    theta = np.union1d(np.geomspace(1e-6, math.pi, 20000), np.linspace(0, math.pi, 20000))
    mu = np.cos(theta)
    for row, phase in zip(found["wavelengths"], root["medium/phase"].data, strict=True):
        own = phase_at(root["medium/theta"].data, phase, theta)
        for name, fit in row["fits"].items():
            p = sum(one["weight"] * (1 - one["g"]**2) / (4 * math.pi * (1 + one["g"]**2 - 2 * one["g"] * mu)**1.5)
                    * (1 + one["alpha"] * mu**2) / (1 + one["alpha"] * (1 + 2 * one["g"]**2) / 3) for one in fit["lobes"])
            assert 2 * math.pi * np.trapezoid(p * np.sin(theta), theta) == pytest.approx(1, abs=1e-5), name
            misdirected = math.pi * np.trapezoid(np.abs(p - own) * np.sin(theta), theta)
            assert fit["error"]["misdirected"] == pytest.approx(misdirected, abs=3e-5), name
            g = 2 * math.pi * np.trapezoid((p - own) * mu * np.sin(theta), theta)
            assert fit["error"]["g"] == pytest.approx(g, abs=1e-5), name
    for i, row in enumerate(found["wavelengths"]):
        assert all(row[name] == root[f"medium/{name}"].data[i] for name in ("sigma_t", "sigma_s", "sigma_a", "albedo", "g"))
        # the sample's phase functions are Henyey-Greenstein's, of g = 0.8 and 0.7
        assert row["fits"]["hg_g"]["lobes"][0]["g"] == pytest.approx((0.8, 0.7)[i], abs=1e-3)
        assert row["fits"]["hg"]["error"]["misdirected"] < 1e-3
        d = row["fits"]["hg_draine_published"]["diameter"]
        assert d == pytest.approx(2 * math.sqrt(0.1 * 60), rel=1e-12)  # geometric mean of radii even in ln r


@pytest.mark.slow
def test_lobes_as_csv_are_the_same(lobes):
    folder, out, err = lobes
    found = json.loads((folder / "fog_lobes.json").read_text())
    with open(folder / "fog_lobes.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == sum(len(row["fits"]) for row in found["wavelengths"])
    at = {row["wavelength"]: row for row in found["wavelengths"]}
    for row in rows:
        fit = at[float(row["wavelength [um]"])]["fits"][row["fit"]]
        for i, one in enumerate(fit["lobes"], 1):
            assert all(float(row[f"{key} {i} [1]"]) == one[key] for key in ("weight", "g", "alpha"))
        assert (row["g 2 [1]"] == "") == (len(fit["lobes"]) == 1)
        assert float(row["misdirected [1]"]) == fit["error"]["misdirected"] and float(row["error of g [1]"]) == fit["error"]["g"]
    assert (folder / "fog_lobes.png").read_bytes().startswith(b"\x89PNG")
    assert out.splitlines() == [str(folder / f"fog_lobes.{form}") for form in ("json", "csv", "png")]
    assert "HG + Draine, published for 4.9 um" in err and "0.61 um: g 0.8000" in err and "misdirected" in err


def test_lobes_load_in_stock_mitsuba():
    from bakery.export.hg import mitsuba
    from bakery.physics.medium.lobes import Lobes

    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    pair = Lobes((0.6, 0.4), (0.9, -0.3), (0.0, 0.0))
    phase, context, at = mi.load_dict(mitsuba(pair)), mi.PhaseFunctionContext(), mi.MediumInteraction3f()
    at.wi = mi.Vector3f(0, 0, -1)  # light travels along +z
    at.sh_frame = mi.Frame3f(at.wi)
    for angle in (0.05, 1.0, 3.0):
        value, _ = phase.eval_pdf(context, at, mi.Vector3f(math.sin(angle), 0, math.cos(angle)))
        assert float(value[0]) == pytest.approx(pair(angle), rel=1e-4)
    assert mitsuba(Lobes((1.0,), (0.5,), (0.0,))) == {"type": "hg", "g": 0.5}
    assert mitsuba(Lobes((0.5, 0.5), (0.9, 0.3), (0.0, 5.0))) is None  # Draine's is no plugin


def test_the_published_fit_is_for_water_in_air():
    from bakery.export.formats.hg import water_in_air

    found = {path.stem: water_in_air(path.read_text()) for path in (ROOT / "recipes").glob("*.yaml")}
    assert sorted(name for name, water in found.items() if water) == [
        "cloud_top", "clouds", "drizzle", "drizzle_particles", "fog", "fog_glow", "street_fog", "thick_fog"]
    assert len(found) > 5
    assert not any(map(water_in_air, ("", "a: [", "particles: 3", "particles: {components: 3}", "particles: {components: [3]}")))


@pytest.mark.slow
def test_lobes_for_machines(call, root, tmp_path):
    """One wavelength, not known to be water: no published fit; the JSON on standard output holds the errors."""
    one = with_member(root, "wavelength", Dataset(np.array([0.61]), "um", "wavelength"))
    for path, member in root["medium"].walk():
        if member.data.shape[0] == 2:
            one = with_member(one, f"medium/{path}", Dataset(member.data[:1], member.units, member.description))
    write(tmp_path / "x.h5", with_member(one, "optics", None))
    status, out, err = call("export", tmp_path / "x.h5", "--to", "hg", "--json", "-o", tmp_path / "o")
    report = json.loads(out)
    assert status == 0 and not err and sorted(report["files"]) == sorted(str(path) for path in (tmp_path / "o").iterdir())
    (row,) = report["lost"]
    assert row["wavelength"] == 0.61 and not any("published" in name for name in row["fits"])
    assert row["fits"]["hg"]["misdirected"] <= row["fits"]["hg_g"]["misdirected"] + 1e-6
    write(tmp_path / "y.h5", with_member(root, "medium", None))
    status, out, err = call("export", tmp_path / "y.h5", "--to", "hg")
    assert status == 2 and not out and "holds no stage `medium`" in err


@pytest.mark.parametrize(("args", "said"), [
    (("--to", "vtk"), 'found "vtk", which is no export format; expected csv'),
    (("--to", "csv", "--each-wavelength"), "has no effect on csv"),
    (("--to", "hg", "--each-wavelength"), "has no effect on hg"),
    ((), "--to"),
])
def test_wrong_calls(call, fog, args, said):
    status, out, err = call("export", fog, *args)
    assert status == 2 and not out and said in err


def test_a_medium_that_only_absorbs(call, root, tmp_path):
    for name, values in (("sigma_s", np.zeros(2)), ("albedo", np.zeros(2))):
        root = with_member(root, f"medium/{name}", Dataset(values, root[f"medium/{name}"].units, name))
    write(tmp_path / "black.h5", root)
    assert call("export", tmp_path / "black.h5", "--to", "mitsuba")[0] == 0
    assert 'name="albedo" value="0.0, 0.0, 0.0"' in (tmp_path / "black-mitsuba" / "black.xml").read_text()


def test_formats_share_a_folder(call, fog, tmp_path):
    """No format replaces another's files: `netcdf` and `eradiate` both wrote fog.nc."""
    paths = []
    for target in ("csv", "mitsuba", "pbrt", "disort", "netcdf", "eradiate"):
        status, out, err = call("export", fog, "--to", target, "-o", tmp_path)
        assert status == 0, err
        paths += out.split()
    assert len(set(paths)) == len(paths) > 6
