"""`bake plot`: pictures that show what the asset holds, the same bytes each time."""

import csv
import json
from xml.etree import ElementTree

import numpy as np
import pytest

from bakery.draw.lobe import INNER, polar
from bakery.draw.picture import drawn
from bakery.draw.style import colours
from bakery.report.figures import pictures
from bakery.store.tree import Dataset, Group
from bakery.store.write import write
from tests.samples import small_asset, with_member


def polarised() -> Group:
    root = small_asset()
    theta, phase = root["medium/theta"].data, root["medium/phase"].data
    s12 = -phase * np.sin(theta) ** 2 / (1 + np.cos(theta) ** 2)
    for name, values in (("s11", phase), ("s12", s12)):
        root = with_member(root, f"medium/{name}", Dataset(values, "1/sr", f"Mueller element {name}"))
    return root


@pytest.fixture(scope="module")
def fog(tmp_path_factory):
    path = tmp_path_factory.mktemp("plot") / "fog.h5"
    write(path, polarised())
    return path


def test_each_picture_as_png_svg_and_csv(call, fog, tmp_path):
    status, out, err = call("plot", fog, "-o", tmp_path / "a")
    assert status == 0, err
    paths = out.split()
    assert sorted(paths) == sorted(str(path) for path in (tmp_path / "a").iterdir())
    names = {path.rpartition("fog_")[2].partition(".")[0] for path in paths}
    assert names == {"phase", "lobe", "polarisation", "coefficients", "droplets_cross_sections"}
    for name in names:
        assert (tmp_path / "a" / f"fog_{name}.png").read_bytes().startswith(b"\x89PNG")
        drawing = (tmp_path / "a" / f"fog_{name}.svg").read_bytes()
        ElementTree.fromstring(drawing)
        assert b"dc:date" not in drawing
    # the data beside the picture is the asset's
    with open(tmp_path / "a" / "fog_phase.csv", newline="") as file:
        head, *rows = csv.reader(file)
    assert head == ["theta [rad]", "phase at 0.61 um [1/sr]", "phase at 0.465 um [1/sr]"]
    values = np.array(rows, float).T
    medium = polarised()["medium"]
    assert np.array_equal(values[0], medium["theta"].data) and np.array_equal(values[1:], medium["phase"].data)


def test_the_same_bytes_each_time_whatever_the_users_own_style(monkeypatch):
    import matplotlib

    (picture,) = [picture for picture in pictures(small_asset()) if picture.name == "coefficients"]
    expected = drawn(picture)
    monkeypatch.setitem(matplotlib.rcParams, "font.size", 30.0)
    monkeypatch.setitem(matplotlib.rcParams, "svg.hashsalt", "mine")
    assert drawn(picture) == expected


def test_the_curves_are_the_values():
    """Read back from the drawing's axes: the phase function over degrees, forward at the left; polarisation 1 at 90 degrees."""
    from matplotlib.figure import Figure

    root = polarised()
    found = {picture.name: picture for picture in pictures(root)}
    figure = Figure()
    found["phase"].draw(figure)
    line = figure.axes[0].lines[0]
    assert np.allclose(line.get_xdata(), np.degrees(root["medium/theta"].data))
    assert np.allclose(line.get_ydata(), root["medium/phase"].data[0], rtol=1e-9)
    assert line.get_ydata()[0] == line.get_ydata().max()
    figure = Figure()
    found["polarisation"].draw(figure)
    line = figure.axes[0].lines[1]
    assert line.get_ydata().max() == pytest.approx(100) and line.get_xdata()[line.get_ydata().argmax()] == pytest.approx(90)


def test_where_rays_take_over_is_drawn():
    """A line a wavelength at the smallest sphere by rays, the words below the phase function; nothing without rays."""
    from matplotlib.figure import Figure

    from tests.cli.test_query import with_rays

    def panels(root, name):
        (picture,) = [picture for picture in pictures(root) if picture.name == name]
        figure = Figure()
        picture.draw(figure)
        return figure, picture.caption

    rays = with_rays(small_asset())
    radius, method = (rays[f"optics/droplets/{name}"].data for name in ("radius", "method"))
    for root, expected in ((rays, [radius[row == 2].min() for row in method]), (small_asset(), [])):
        figure, caption = panels(root, "droplets_cross_sections")
        for axes in figure.axes:
            upright = [line.get_xdata()[0] for line in axes.lines if len(line.get_xdata()) == 2 and np.ptp(line.get_xdata()) == 0]
            assert upright == expected
        assert ("Mie left of the dots, rays right" in [text.get_text() for text in figure.axes[0].texts]) == bool(expected)
        assert ("rays above" in caption) == bool(expected)
        figure, caption = panels(root, "phase")
        assert figure.get_supxlabel() == ("droplets: Mie below 34.9, 25.2 um (x = 340), rays above; rays differ by up to 0.6 %"
                                          if expected else "")
        assert ("rays above" in caption) == bool(expected)
    drawn([picture for picture in pictures(with_rays(small_asset(), (0.5, 340.0))) if "cross" in picture.name][0], ("png",))


def test_the_size_distribution_integrates_to_one():
    """From nodes that crowd in one place: neither the sum nor the shape may show them."""
    from bakery.stages.optics.pictures import _density

    at = np.sort(np.concatenate([np.linspace(-3, 3, 2000), np.linspace(0, 0.5, 3000)]))
    cell = np.gradient(at)
    weight = np.exp(-at**2 / 2) * cell
    weight /= weight.sum()
    where, density = _density(np.exp(at), weight)
    step = 6 / where.size
    assert density.sum() * step == pytest.approx(1, abs=1e-3)
    assert np.allclose(density, np.exp(-np.log(where) ** 2 / 2) / np.sqrt(2 * np.pi) / 0.9973, atol=4e-3)


@pytest.mark.slow
def test_extremes_are_drawn(tmp_path):
    """Isotropic, without absorption, one wavelength, a zero in the phase function, eight wavelengths in the infrared."""
    theta = np.linspace(0, np.pi, 181)
    isotropic, doughnut = np.full((1, 181), 1 / (4 * np.pi)), np.sin(np.tile(theta, (8, 1)))
    for um, phase in ((np.array([0.55]), isotropic), (np.linspace(2, 12, 8), doughnut)):
        one, zero = np.ones(um.size), np.zeros(um.size)
        medium = {"theta": (theta, "rad"), "phase": (phase, "1/sr"), "sigma_t": (one, "1/m"), "sigma_s": (one, "1/m"),
                  "sigma_a": (zero, "1/m"), "albedo": (one, "1"), "g": (zero, "1")}
        root = Group({"wavelength": Dataset(um, "um", "w"),
                      "medium": Group({name: Dataset(data, unit, name) for name, (data, unit) in medium.items()})})
        for picture in pictures(root):
            assert drawn(picture, ("png",))["png"].startswith(b"\x89PNG")
    assert len(set(colours(np.linspace(2, 12, 8)))) == 8


def axes_of(root: Group, name: str):
    """The axes of a picture, and its caption."""
    from matplotlib.figure import Figure

    (picture,) = [picture for picture in pictures(root) if picture.name == name]
    figure = Figure()
    picture.draw(figure)
    return figure.axes, picture.caption


def test_lobes_have_an_inner_and_an_outer_limit():
    """A forward peak of nine decades neither fills the picture nor presses the rest into its middle; nothing leaves the axes."""
    root = small_asset()
    theta = root["medium/theta"].data
    peaked = np.tile(1e7 * np.exp(-theta / 1e-3) + 0.1 + 1e-9 * theta, (2, 1))
    (axes,), caption = axes_of(with_member(root, "medium/phase", Dataset(peaked, "1/sr", "phase")), "lobe")
    (label,) = [text.get_text() for text in axes.texts if "peak cut" in text.get_text()]
    assert label == "peak cut,\nto 1e+07" and "rises to 1e+07" in caption
    assert {"10⁻¹", "10⁰"} < {text.get_text() for text in axes.texts}  # the circles
    for line in axes.lines:
        radius = np.hypot(*line.get_xydata().T)
        assert radius.min() > INNER and radius.max() == pytest.approx(1, abs=1e-12)
    zero = np.where(theta > 2, 0.0, peaked)  # no light at all goes to the inner circle
    (axes,), _ = axes_of(with_member(root, "medium/phase", Dataset(zero, "1/sr", "phase")), "lobe")
    for line in axes.lines:
        assert np.hypot(*line.get_xydata().T).min() == pytest.approx(INNER, abs=1e-12)


def test_lobes_look_forward_to_the_right():
    from matplotlib.figure import Figure

    theta, value = np.linspace(0, np.pi, 181), np.full((1, 181), 1.0)
    value[0, theta < 1] = 100.0
    axes = Figure().subplots()
    polar(axes, theta, value, (-1.0, 2.0), ["k"], ["x"])
    x, y = axes.lines[0].get_xydata().T
    radius = np.hypot(x, y)
    assert np.allclose(radius[x > np.cos(0.9)], 1) and np.allclose(radius[x < 0], INNER + (1 - INNER) / 3)


def test_an_isotropic_lobe_is_a_circle():
    """Its table has two angles."""
    from matplotlib.figure import Figure

    axes = Figure().subplots()
    polar(axes, np.array([0, np.pi]), np.full((1, 2), 1.0), (-1.0, 1.0), ["k"], ["x"])
    x, y = axes.lines[0].get_xydata().T
    assert np.allclose(np.hypot(x, y), INNER + (1 - INNER) / 2) and np.diff(np.unwrap(np.arctan2(y, x))).max() < 0.02


def test_coefficients_have_ticks_and_no_empty_panel():
    root = small_asset()
    three, _ = axes_of(root, "coefficients")
    assert [axes.get_yscale() for axes in three] == ["log", "linear", "linear"]  # 1 - albedo is about 1e-3 at both
    clear = with_member(root, "medium/sigma_a", Dataset(root["medium/sigma_t"].data * 1e-5, "1/m", "absorption"))
    axis = axes_of(clear, "coefficients")[0][1].yaxis
    assert axis.get_major_formatter().format_ticks([9.5e-6, 1e-5, 0, 1e-22]) == ["0.95×10⁻⁵", "1×10⁻⁵", "0", "0"]
    assert axis.get_offset_text().get_text() == ""
    axis.set_view_interval(-0.5, 0.3, ignore=True)
    assert axis.get_major_formatter().format_ticks([-0.25, 3e-17, 0.1 + 0.2]) == ["−0.25", "0", "0.3"]
    black = with_member(root, "medium/sigma_a", Dataset(np.zeros(2), "1/m", "absorption"))
    two, caption = axes_of(black, "coefficients")
    assert len(two) == 2 and "nothing is absorbed" in caption
    wide = with_member(root, "medium/sigma_a", Dataset(root["medium/sigma_t"].data * [1e-3, 0.5], "1/m", "absorption"))
    assert axes_of(wide, "coefficients")[0][1].get_yscale() == "log"


def test_figures_name_their_asset(monkeypatch):
    from bakery.report.figures import title_of

    said = []
    monkeypatch.setattr("bakery.draw.picture.saved", lambda figure, forms: said.append(
        [text.get_text() for text in figure.findobj(match=lambda artist: hasattr(artist, "get_text"))]) or {})
    root = Group(small_asset().members, {"name": "fog", "content_hash": "abcdef" * 10})
    assert title_of(root) == "fog  ·  abcdefabcdef"
    for picture in pictures(root):
        drawn(picture, ("png",), title_of(root))
        assert title_of(root) in said[-1], picture.name


def test_colours_can_be_told_apart():
    """Distances in CIE Lab of any two of the recipes' eight wavelengths, and of eight in the infrared; 2.3 is just noticeable."""
    def lab(rgb):
        linear = np.where(np.array(rgb) <= 0.04045, np.array(rgb) / 12.92, ((np.array(rgb) + 0.055) / 1.055) ** 2.4)
        to_xyz = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
        x, y, z = np.cbrt(to_xyz @ linear / [0.9505, 1.0, 1.089])
        return np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])

    for um, least in ((np.arange(0.405, 0.76, 0.05), 25), (np.linspace(2, 12, 8), 15)):
        found = np.array([lab(colour) for colour in colours(um)])
        apart = np.linalg.norm(found[:, None] - found, axis=-1)
        assert len(um) == 8 and apart[~np.eye(8, dtype=bool)].min() > least


def test_colours_are_those_of_light():
    red, green, blue = colours(np.array([0.610, 0.550, 0.465]))
    assert max(red) == red[0] and max(green) == green[1] and max(blue) == blue[2]


@pytest.mark.usefixtures("undrawn")
def test_where_pictures_go(call, fog, tmp_path):
    (tmp_path / "file").write_text("")
    status, out, err = call("plot", fog, "-o", tmp_path / "file")
    assert status == 2 and not out and "found a file where a folder should be" in err
    write(tmp_path / "x.h5", with_member(small_asset(), "optics", None))
    status, out, _ = call("plot", tmp_path / "x.h5", "--json")
    picture = json.loads(out)[-1]
    assert status == 0 and picture["files"]["csv"] == str(tmp_path / "x-plots" / "x_coefficients.csv")
    written = sorted(path.name for path in (tmp_path / "x-plots").iterdir())
    assert written == [f"x_{name}.{form}" for name in ("coefficients", "lobe", "phase") for form in ("csv", "png", "svg")]
