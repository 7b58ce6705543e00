"""What assets show in notebooks, and what they are asked from Python."""

import errno
import math

import numpy as np
import pytest

import bakery
from bakery.asset.lookup import lookup
from bakery.errors import StoreError, UsageError
from bakery.store.tree import Dataset
from bakery.store.write import write
from tests.samples import small_asset, with_member


@pytest.fixture(scope="module")
def asset(tmp_path_factory):
    path = tmp_path_factory.mktemp("notebook") / "fog.h5"
    theta = small_asset()["medium/theta"].data
    write(path, with_member(small_asset(), "medium/odd", Dataset(np.zeros(len(theta)), "1", "<script>alert(1)</script>")))
    return bakery.open(path)


def test_queries_take_text_with_units_and_numbers(asset):
    by_text = asset.query("medium/phase", wavelength="610 nm", theta="[0, 90] deg")
    by_number = asset.query("medium/phase", wavelength=0.61, theta=[0.0, np.pi / 2])
    assert np.array_equal(by_text, by_number) and np.array_equal(by_text, asset.medium.phase([0, np.pi / 2])[0])
    assert by_text.units == "1/sr" and by_text.axes[0][0] == "theta" and by_text.error.shape == (2,)
    assert float(np.asarray(asset.query("medium/g", wavelength=0.61))) == asset.medium.g[0]
    assert asset.query("medium/achieved_error") == 0.004 and asset.query("recipe") == asset.recipe


@pytest.mark.parametrize(("path", "arguments", "said"), [
    ("medium/phse", {}, "fog.h5: found no \"medium/phse\"; did you mean medium/phase?"),
    ("medium/phase", {"tetha": 0.1}, 'found "tetha"; did you mean theta=…?'),
    ("medium/g", {"wavelength": "550"}, "the asset holds 0.61, 0.465 um"),
    ("name", {"theta": 1.0}, "theta has no effect on it"),
    ("medium/g", {"wavelength": math.nan}, "wavelength: found nan; expected a finite number"),
    ("medium/g", {"wavelength": [0.5, math.nan]}, "wavelength: found nan; expected a finite number"),
    ("optics/droplets/sigma_t", {"radius": math.inf}, "radius: found inf; expected a finite number"),
    ("medium/g", {"wavelength": None}, 'wavelength: found "None"; expected a number, several of them, or text with a unit'),
    *(("medium/g", {"wavelength": odd}, "expected a number, several of them, or text with a unit")
      for odd in (["550 nm"], ["0.55"], b"0.55", [0.55 + 1j], np.complex64(0.55), [], [[0.5], [0.5, 0.6]])),
    *(("medium/g", {"wavelength": large}, "wavelength: found inf; expected a finite number")
      for large in (10**400, [0.5, 10**400])),
])
def test_wrong_questions_are_told(asset, path, arguments, said):
    with pytest.raises(UsageError, match=said.replace("?", r"\?").replace("(", r"\(")):
        asset.query(path, **arguments)


@pytest.mark.parametrize("name", ["wavelength", "theta"])
def test_a_look_up_itself_takes_no_nan(asset, name):
    with pytest.raises(UsageError, match=f"{name}: found nan"):
        lookup(asset.tree, "medium/phase", {name: math.nan})


def test_phase_functions_are_drawn_as_the_command_draws_them(asset):
    picture = asset.medium.phase.plot()
    (_, theta), *curves = picture.columns
    assert [heading for heading, _ in curves] == ["phase at 0.61 um [1/sr]", "phase at 0.465 um [1/sr]"]
    assert np.array_equal(theta, asset.medium.theta) and np.array_equal([row for _, row in curves], asset.medium["phase"])
    assert "Largest error: 0.1 %" in picture.caption  # phase_bias of the sample
    assert np.array_equal(asset.optics.droplets.phase.plot().columns[1][1], asset.optics.droplets["phase"][0])
    with pytest.raises(UsageError, match="one curve a wavelength"):
        type(asset.medium.phase)(asset.medium.theta, asset.medium["phase"][0]).plot()


def test_pictures_are_saved_by_the_ending_of_the_path(asset, tmp_path, undrawn):
    picture = asset.medium.phase.plot()
    assert picture.save(tmp_path / "phase.png").read_bytes().startswith(b"\x89PNG")
    assert picture.save(f"{tmp_path}/phase.SVG").read_bytes().startswith(b"<svg")
    assert picture.save(tmp_path / "phase.csv").read_text().startswith("theta [rad],phase at 0.61 um [1/sr],")
    with pytest.raises(UsageError, match=r"found a name that does not end in .png, .svg or .csv; expected \S+phase.png"):
        picture.save(tmp_path / "phase.jpg")
    for folder in ".", "":
        with pytest.raises(UsageError, match=f"expected .*{picture.name}.png"):
            picture.save(folder)
    with pytest.raises(UsageError, match="its folder does not exist"):
        picture.save(tmp_path / "missing" / "phase.png")


def test_a_picture_is_written_whole_or_not_at_all(asset, tmp_path, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    picture, path = asset.medium.phase.plot(), tmp_path / "phase.csv"
    picture.save(path)
    before = path.read_bytes()
    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(StoreError, match="No space left"):
        picture.save(path)
    assert path.read_bytes() == before and list(tmp_path.iterdir()) == [path]


def test_notebooks_show_tables_and_pictures(asset, monkeypatch):
    monkeypatch.setattr("bakery.draw.picture.drawn", lambda picture, forms, of="": {"png": b"PNG of " + picture.name.encode()})
    image = 'src="data:image/png;base64,UE5HIG9mIHBoYXNl"'  # "PNG of phase"
    whole, part = asset._repr_html_(), asset.medium._repr_html_()
    assert image in whole and "fog, wavelength 0.61 0.465 um" in whole and "0.004 of 0.01" in whole
    assert image in asset.medium.phase._repr_html_() and "single-scattering albedo" in part
    assert "&lt;script&gt;" in part and "<script>" not in part
    answer = asset.query("medium/phase", wavelength=0.5)._repr_html_()
    assert answer.count("<tr>") == 1 + 30 + 1 and "as a power of the wavelength between" in answer
    assert asset.query("medium/g", wavelength=0.61)._repr_html_().count("<tr>") == 2


def test_a_plain_shell_shows_little(asset):
    answer = repr(asset.query("medium/phase", wavelength=0.5)).splitlines()
    assert len(answer) == 1 + 30 + 1 + 1 and "medium" not in answer[0] and "theta [rad]  phase [1/sr]" in answer[0]
    assert answer[-1].startswith("# as a power of the wavelength between")
    g = repr(asset.query("medium/g", wavelength=0.61)).split()
    assert g[:2] == ["g", "[1]"] and float(g[2]) == pytest.approx(float(asset.query("medium/g", wavelength=0.61).values), 1e-5)
    picture = repr(asset.medium.phase.plot())
    assert picture.startswith("picture 'phase': ") and ".save(FILE)" in picture and len(picture) < 200 and "\n" not in picture


@pytest.mark.slow
def test_families_show_themselves(command, tmp_path):
    from tests.conftest import MILK

    (tmp_path / "milk.yaml").write_text(MILK.format(name="milk", g=0.7))
    assert command("milk.yaml", "--sweep", "medium.phase.g=[0.1, 0.2, 0.3]", "-o", "milk.h5", cwd=tmp_path).returncode == 0
    family = bakery.open(tmp_path / "milk.h5")
    assert "image/png" in family._repr_html_() and "medium.phase.g" in family._repr_html_()
    assert family.query("family/sigma_t").values.shape[-1] == 3
    with pytest.raises(UsageError, match="is a family"):
        family.query("medium/g")
