"""`bake plot`, `report` and `export` of packed grains: what is drawn and written is what the asset holds."""

import csv
import json

import numpy as np
import pytest

import bakery
from bakery.draw import meshes
from bakery.draw.light import cosines_of_light
from bakery.draw.picture import drawn
from bakery.export.medium import scattering_of
from bakery.physics.medium.phase import mean_cosine, phase_integral
from bakery.physics.shapes.build import build
from bakery.physics.shapes.files import triangles
from bakery.report.figures import pictures
from bakery.stages.grains.pictures import _GAP, FIGURES, concise
from bakery.store.tree import Dataset
from bakery.store.write import write
from tests.grain_assets import RADIUS, asset, component
from tests.samples import with_member

GLASS = {"type": "dielectric", "index": [1.5, 1.5, 1.5], "roughness": 0.0}
SALT = {"type": "dielectric", "index": [1.54, 1.544, 1.553], "roughness": 0.0}
CUBE = {"type": "box", "size": [1, 1, 1]}


@pytest.fixture(scope="module")
def tree():
    return asset({"glass": component({"type": "sphere"}, GLASS, weight=0.4, interior=(200.0, 100.0, 400.0)),
                  "salt": component(CUBE, SALT, weight=0.6, tolerance=0.1, by_radius=True)}, radii=(0.5, 1.0, 1.5), name="mix")


@pytest.fixture(scope="module")
def mix(tree, tmp_path_factory):
    path = tmp_path_factory.mktemp("grains") / "mix.h5"
    write(path, tree)
    return path


def table(path):
    with open(path, newline="") as file:
        head, *rows = csv.reader(file)
    return dict(zip(head, zip(*rows, strict=True), strict=True))


# ---- plot


def test_each_picture_with_its_data(call, undrawn, mix, tree, tmp_path):
    status, out, err = call("plot", mix, "-o", tmp_path, "--json")
    assert status == 0, err
    found = {picture["name"]: picture for picture in json.loads(out)}
    assert list(found) == ["grains", "walks", "grain_scattering", "grain_sizes", "extinction", "phase", "lobe", "coefficients"]
    salt = tree["grains/salt"]
    share = 100 * salt["forward_delta"].data
    said = found["grain_scattering"]["caption"].split("  ")
    assert share.min() > 10 and any(part.startswith("salt: ") and f"{share[0]:.3g} %" in part for part in said)  # parallel faces
    assert not any(part.startswith("glass: ") and "unscattered (delta)" in part for part in said)
    assert f"{int(salt['paths'].data[0]):,}".replace(",", " ") in found["walks"]["caption"]
    assert "glass: in closed form" in found["walks"]["caption"]
    walks = table(tmp_path / "mix_walks.csv")
    assert walks["component"] == ("glass",) * 3 + ("salt",) * 3
    assert [float(x) for x in walks["g [1]"][3:]] == salt["g"].data.tolist()
    assert [float(x) for x in walks["standard error of g [1]"][3:]] == salt["g_error"].data.tolist()
    phase = table(tmp_path / "mix_grain_scattering.csv")
    for name in ("glass", "salt"):
        assert [float(x) for x in phase[f"{name} phase at 0.55 um [1/sr]"]] == tree[f"grains/{name}/phase"].data[1].tolist()


def test_dots_and_bars_are_the_values(tree):
    from matplotlib.collections import LineCollection, PathCollection
    from matplotlib.figure import Figure

    found = {picture.name: picture for picture in pictures(tree)}
    figure = Figure()
    found["walks"].draw(figure)
    (axes,) = figure.axes
    *_, bars = (collection for collection in axes.collections if isinstance(collection, LineCollection))
    (dots,) = (collection for collection in axes.collections if isinstance(collection, PathCollection))
    column, (low, high) = list(FIGURES).index("lambda_s"), FIGURES["lambda_s"][2]
    left = column * (1 + _GAP)
    inside = np.abs(dots.get_offsets()[:, 0] - left - 0.5) < 0.5 + _GAP / 2
    expected = [tree[f"grains/{name}/lambda_s"].data for name in ("glass", "salt")]
    np.testing.assert_allclose(low + (high - low) * (dots.get_offsets()[inside, 0] - left), np.concatenate(expected), atol=1e-12)
    errors = np.concatenate([tree[f"grains/{name}/lambda_s_error"].data for name in ("glass", "salt")])
    wide = np.array([np.ptp(bar.vertices[:, 0]) for bar in bars.get_paths()])[inside]
    np.testing.assert_allclose((high - low) * wide, 2 * errors, atol=1e-12)
    assert (np.abs(dots.get_offsets()[:, 0] - 0.5) <= 0.5).sum() == 2  # the hit probability: one for all wavelengths
    texts = [text.get_text() for text in axes.texts]
    assert concise(expected[1][0], tree["grains/salt/lambda_s_error"].data[0]) in texts
    figure = Figure()
    found["extinction"].draw(figure)
    medium = tree["medium"]
    shown = [container for container in figure.axes[0].containers if container.get_label().startswith("mean flight")][0]
    assert "taken" in shown.get_label()
    np.testing.assert_allclose(shown.lines[0].get_xdata(), 1e-3 * medium["sigma_t_mean_flight"].data)
    right = [container for container in figure.axes[1].containers][0].lines[0].get_xdata()
    np.testing.assert_allclose(right, 100 * (medium["sigma_t_random_walk"].data / medium["sigma_t_mean_flight"].data - 1))


@pytest.mark.parametrize("name", ["grains", "grain_scattering", "grain_sizes"])
def test_what_only_grains_have_is_drawn(tree, name):
    (picture,) = [picture for picture in pictures(tree) if picture.name == name]
    assert drawn(picture, ("png",), of="mix")["png"].startswith(b"\x89PNG")


@pytest.mark.slow
def test_the_same_bytes_each_time(tree):
    (picture,) = [picture for picture in pictures(tree) if picture.name == "walks"]
    assert drawn(picture) == drawn(picture)
    salt = tree["grains/salt"]
    images = [meshes.rendered(salt["vertices"].data, salt["faces"].data, np.ones(3), 40) for _ in range(2)]
    np.testing.assert_array_equal(*images)


@pytest.mark.parametrize(("value", "error", "said"), [
    (1.3885, 0.0022, "1.3885(22)"), (0.64868, 0.000175, "0.64868(18)"), (2.96, 0.0996, "2.96(10)"), (0.5, 0.0, "0.5"),
    (1 / 3, 1e-12, "0.33333"), (1234.6, 25.0, "1235(25)"), (-0.25, 0.01, "-0.250(10)"), (3.0, 2.0, "3.0(20)"), (0.0, 0.0, "0")])
def test_errors_in_brackets(value, error, said):
    assert concise(value, error) == said


def test_a_mesh_that_is_none_is_named(call, tree, tmp_path):
    faces = tree["grains/salt/faces"]
    write(tmp_path / "x.h5", with_member(tree, "grains/salt/faces", Dataset(faces.data + 7, faces.units, faces.description)))
    for words in (("plot", "-o", tmp_path / "p"), ("export", "--to", "ply", "-o", tmp_path / "e"), ("report",)):
        status, out, err = call(words[0], tmp_path / "x.h5", *words[1:])
        assert status == 2 and not out and "grains/salt/faces: holds 14, above 7" in err and err.count("\n") == 1


# ---- the drawing of meshes


def test_a_cube_covers_its_shadow():
    """Coverage of the picture against the cube's projection: half of sum |n.v| area over its faces, 1 % for pixels at edges."""
    cube = build(CUBE)
    image = meshes.rendered(cube.vertices, cube.faces, np.array([0.5, 0.5, 0.5]), 120)
    view = np.array([1.0, 0.72, 0.62]) / np.linalg.norm([1.0, 0.72, 0.62])
    assert image[..., 3].sum() / 255 * (2.04 / 120) ** 2 == pytest.approx(4 / 3 * np.abs(view).sum(), rel=0.01)
    solid = image[..., 3] == 255
    grey, count = np.unique(image[solid][:, 1].astype(int), return_counts=True)
    faces = grey[np.argsort(count)[-3:]]
    assert np.sort(count)[-3:].sum() > 0.9 * solid.sum() and np.diff(np.sort(faces)).min() > 12  # each face of one brightness
    ball = meshes.rendered(None, cube.faces, np.array([0.5, 0.5, 0.5]), 120)
    assert ball[..., 3].sum() / 255 * (2.04 / 120) ** 2 == pytest.approx(np.pi, rel=0.01)


def test_depths_are_those_of_rays():
    """Against every triangle in turn, for each pixel, in plain NumPy."""
    rock = build({"type": "rock", "seed": 3}, 300)
    low, pixel, size = np.array([-1.0, -1.0]), 2 / 23, 23
    index, depth = meshes.depths(rock.vertices, rock.faces.astype(np.int64), low, pixel, size, size)
    a, b, c = (rock.vertices[rock.faces[:, k]] for k in range(3))
    for row in range(size):
        for column in range(size):
            p = low + (np.array([column, row]) + 0.5) * pixel
            sides = [(v[:, 0] - u[:, 0]) * (p[1] - u[:, 1]) - (v[:, 1] - u[:, 1]) * (p[0] - u[:, 0])
                     for u, v in ((a, b), (b, c), (c, a))]
            inside = np.all([s >= 0 for s in sides], axis=0) | np.all([s <= 0 for s in sides], axis=0)
            if not inside.any():
                assert index[row, column] == -1
                continue
            normal = np.cross(b - a, c - a)[inside]
            z = a[inside, 2] - ((p - a[inside, :2]) * normal[:, :2]).sum(axis=1) / normal[:, 2]
            assert depth[row, column] == pytest.approx(z.max(), abs=1e-9)


def test_normals_are_smooth_where_the_surface_is():
    cube, globe = build(CUBE), build({"type": "sphere"}, 1300)
    normals = meshes.smooth_normals(cube.vertices, cube.faces.astype(np.int64), meshes.CREASE)
    assert np.allclose(np.sort(np.abs(normals), axis=-1), [0, 0, 1], atol=1e-12)  # edges stay sharp
    normals = meshes.smooth_normals(globe.vertices, globe.faces.astype(np.int64), meshes.CREASE)
    assert (normals * globe.vertices[globe.faces]).sum(axis=-1).min() > 0.999


def test_what_stands_in_the_light_takes_it():
    """A small plate above a large one, light from straight above: dark below it, cos(0) elsewhere, nothing from below."""
    plate = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)
    vertices = np.concatenate([0.9 * plate, 0.3 * plate + [0, 0, 0.5]])
    faces = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]])
    low, pixel = np.array([-1.0, -1.0]), 2 / 40
    _, shadow = meshes.depths(vertices, faces, low, pixel, 40, 40)
    index, depth = meshes.depths(vertices[:4], faces[:2], low, pixel, 40, 40)
    normals = meshes.smooth_normals(vertices[:4], faces[:2], meshes.CREASE)
    covered, place, normal = meshes.surfaces(index, depth, vertices[:4], faces[:2], normals, low, pixel)
    light = np.zeros((40, 40))
    for towards in ([0.0, 0.0, 1.0], [0.0, 0.0, -1.0]):
        light[covered] += cosines_of_light(place.T, normal.T, np.array(towards), np.eye(3), (shadow, low, pixel))
    at = (np.arange(40) + 0.5) / 20 - 1
    across = np.maximum(np.abs(at), np.abs(at[:, None]))
    assert np.all(light[across < 0.3] == 0) and np.all(light[across > 0.9] == 0)
    assert np.all(light[(across > 0.3) & (across < 0.9)] == 1)


# ---- report


def test_the_page_holds_pictures_and_figures(call, undrawn, mix, tree, tmp_path):
    status, _, err = call("report", mix, "-o", tmp_path / "x.html", "--no-render")
    assert status == 0, err
    page = (tmp_path / "x.html").read_text()
    assert page.count('<figure class="drawing">') == 8 and "<h2>Grains</h2>" in page
    g, error = (tree[f"grains/salt/{name}"].data[2] for name in ("g", "g_error"))
    assert f"<td class=\"n\">{concise(g, error)}</td>" in page
    sigma, error = (tree[f"medium/sigma_t_mean_flight{end}"].data[0] for end in ("", "_error"))
    assert f"{sigma:.6g} ± {error:.2g}" in page and "sigma_t_mean_flight_error (1/m)" not in page


# ---- export


@pytest.mark.parametrize("form", ["ply", "obj"])
def test_meshes_come_back(call, mix, tree, tmp_path, form):
    status, out, err = call("export", mix, "--to", form, "-o", tmp_path)
    assert status == 0 and "radii of their bounding sphere" in err, err
    for name in ("glass", "salt"):
        data = (tmp_path / f"mix-{name}.{form}").read_bytes()
        vertices, faces = triangles(data, form)[:2]
        stored = tree[f"grains/{name}"]
        np.testing.assert_array_equal(np.asarray(vertices)[np.asarray(faces)], stored["vertices"].data[stored["faces"].data])
        assert f"radius {0.5 * RADIUS!r} to {1.5 * RADIUS!r} m".encode() in data
        assert (b"exactly the unit ball" in data) == (name == "glass")


def test_tiles_stand_beside_grains(call, tree, tmp_path):
    (tmp_path / "tile.yaml").write_text("bakery: 1\nname: tile\ntolerance: 10%\npacking: {fraction: 0.2, count: 8}\n")
    packing = bakery.open(bakery.bake(tmp_path / "tile.yaml", tmp_path / "packing.h5")).tree["packing"]
    whole = with_member(with_member(tree, "packing", packing), "medium", None)
    bare = with_member(whole, "grains", None)
    for name, root, form, expected in (("both", whole, "ply", ["both-glass.ply", "both-salt.ply", "both_tile.ply"]),
                                       ("xyz", whole, "xyz", ["xyz.xyz"]), ("tile", bare, "ply", ["tile.ply"])):
        write(tmp_path / f"{name}.h5", root)
        status, _, err = call("export", tmp_path / f"{name}.h5", "--to", form, "-o", tmp_path / name)
        assert status == 0, err
        assert sorted(path.name for path in (tmp_path / name).iterdir()) == expected
    status, out, err = call("export", tmp_path / "tile.h5", "--to", "obj")
    assert status == 2 and not out and "holds no stage `grains`" in err


def test_tables(call, mix, tree, tmp_path):
    status, _, err = call("export", mix, "--to", "csv", "-o", tmp_path)
    assert status == 0, err
    figures = table(tmp_path / "mix_grains_salt_figures.csv")
    row = figures["figure"].index("hit_probability")
    salt = tree["grains/salt"]
    assert float(figures["value"][row]) == salt["hit_probability"].data[0]
    assert float(figures["standard error"][row]) == salt["hit_probability_error"].data[0]
    sized = table(tmp_path / "mix_grains_salt_by_radius.csv")
    assert [float(x) for x in sized["radius [m]"]] == tree["grains/radius"].data.tolist()
    assert [float(x) for x in sized["g at 0.465 um [1]"]] == salt["by_radius/g"].data[:, 2].tolist()
    names = {path.name for path in tmp_path.iterdir()}
    assert {"mix_grains_salt_vertices.csv", "mix_grains_salt_surface.txt", "mix_medium_figures.csv"} <= names
    assert "mix_grains_salt_hit_probability.csv" not in names


@pytest.mark.slow
def test_light_that_is_not_turned_is_not_exported(call, mix, tree, tmp_path):
    """A cube's Dirac peak fits no regular grid: taken out, absorption and turned light stay, the table loses next to nothing."""
    medium = tree["medium"]
    rest, share = scattering_of(medium), medium["forward_delta"].data
    assert share.min() > 0.1
    np.testing.assert_allclose(rest.sigma_t - rest.sigma_s, medium["sigma_a"].data, rtol=1e-9)
    turned = medium["sigma_s"].data * (1 - mean_cosine(medium["theta"].data, medium["phase"].data))
    np.testing.assert_allclose(rest.sigma_s * (1 - mean_cosine(rest.theta, rest.phase)), turned, rtol=1e-6)
    np.testing.assert_allclose(phase_integral(rest.theta, rest.phase), 1, rtol=1e-9)
    assert rest.phase[:, 0].max() < 1e-3 * medium["phase"].data[:, 0].min()
    status, out, err = call("export", mix, "--to", "mitsuba", "-o", tmp_path, "--json")
    assert status == 0, err
    (lost,) = json.loads(out)["lost"]
    assert lost["unscattered"] == pytest.approx(share.max()) and lost["resampling"]["misdirected"] < 1e-3
    assert "unscattered (delta) transmission" in (tmp_path / "mix.xml").read_text()
    status, out, err = call("export", mix, "--to", "hg", "-o", tmp_path)
    assert status == 0 and "taken out of coefficients" in err, err
    made = json.loads((tmp_path / "mix_lobes.json").read_text())["wavelengths"]
    np.testing.assert_allclose([row["sigma_t"] for row in made], rest.sigma_t)
