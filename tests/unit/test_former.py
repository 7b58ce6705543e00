"""Scenes of format 1 as texts of format 2, and the message that has them."""

import pytest

from bakery.errors import RecipeError
from bakery.grammar import text
from renderers import scene
from renderers.scene import former

HEAD = "# A scene.\nbakery_scene: 1                          # format\nname: s\n"
FORMER = {  # name -> what stands behind the head, and in its place the list that it becomes
    "particles": ("recipe: drops.yaml   # of rain\ntolerance: 10%\ndiscrete:\n  # behind the wall\n"
                  "  where: {box: {lo: [0, 0, 0] m, hi: [1, 1, 1] m}}\n  method: query\n  footprint: 0.3\n"
                  "  velocity: [0, 0, -2] m/s\ndisplay: {exposure: 3}\n",
                  [{"where": "{box: {lo: [0, 0, 0] m, hi: [1, 1, 1] m}}", "recipe": "drops.yaml", "method": "query",
                    "footprint": "0.3", "velocity": "[0, 0, -2] m/s"}]),
    "no place": ("asset: drops.h5\ndiscrete: {}\n", [{"asset": "drops.h5"}]),
    "grains": ("asset: sand.h5\ngranular:\n  where:\n    mesh: a.ply\n    unit: 1 mm\n    fraction: {grid: f.npy}\n    mixture:\n"
               "      red: {grid: r.npy}\n  method: ept+vpt\n  spread: 2\n",
               [{"where": "{mesh: a.ply, unit: 1 mm}", "asset": "sand.h5", "method": "ept+vpt", "fraction": "{grid: f.npy}",
                 "mixture": "{red: {grid: r.npy}}", "spread": "2"}]),
    "heaps": ("asset: sand.h5\ngranular: {method: vpt, where: [{mesh: a.ply}, {mesh: b.ply, recipe: salt.yaml}]}\n",
              [{"where": "{mesh: a.ply}", "asset": "sand.h5"}, {"where": "{mesh: b.ply}", "recipe": "salt.yaml"}]),
    "bodies": ("recipe: wax.yaml\nscene: {mitsuba: s.xml}\ntranslucent:\n  boundary: mirrored\n  bodies:\n"
               "    - {shape: a, boundary: {index: 1.4}}\n    - {shape: b}\n",
               [{"where": "{shape: a}", "recipe": "wax.yaml", "boundary": "{index: 1.4, tables: mirrored}"},
                {"where": "{shape: b}", "recipe": "wax.yaml", "boundary": "{tables: mirrored}"}]),
}


def tree(document):
    return text.parse(text.Source("s.yaml", document)).root


def plain(node):
    if isinstance(node, text.Mapping):
        return {name: plain(child) for name, child in node.items()}
    return [plain(child) for child in node] if isinstance(node, text.Sequence) else node.text


@pytest.mark.parametrize("name", FORMER)
def test_each_section_becomes_a_list(name):
    body, entries = FORMER[name]
    new = former.converted(HEAD + body, tree(HEAD + body))
    root = tree(new)
    assert root["bakery_scene"].text == "2" and not {"asset", "recipe", *former.SECTIONS} & set(root)
    expected = ["{" + ", ".join(f"{key}: {value}" for key, value in one.items()) + "}" for one in entries]
    assert [plain(one) for one in root["materials"]] == [plain(tree(one)) for one in expected]
    assert ("method" in root) == (name == "heaps")  # of several entries it stands once
    for comment in (line[line.index("#"):] for line in (HEAD + body).splitlines() if "#" in line):
        assert comment in new
    assert former.converted(new, root) is None


def test_a_flow_mapping_and_fog():
    flow = "{bakery_scene: 1, name: s, asset: a.h5, discrete: {method: auto}}"
    assert plain(tree(former.converted(flow, tree(flow)))) == {
        "bakery_scene": "2", "name": "s", "materials": [{"asset": "a.h5", "method": "auto"}]}
    fog = HEAD + "asset: a.h5\npicture: {mitsuba: s.xml}\nfog: {}\n"
    assert former.converted(fog, tree(fog)) == fog.replace("bakery_scene: 1", "bakery_scene: 2")


def test_the_message_has_the_new_text(tmp_path):
    """One message, with the line of the format; its text loads."""
    for name in ("drops.h5", "s.xml"):
        (tmp_path / name).touch()
    (tmp_path / "s.yaml").write_text(HEAD + "asset: drops.h5\ndiscrete: {method: query}\n")
    with pytest.raises(RecipeError) as fault:
        scene.load(tmp_path / "s.yaml")
    said = str(fault.value)
    assert said.startswith(f"{tmp_path / 's.yaml'}:2: bakery_scene: found a scene of an earlier format") and "^" not in said
    (tmp_path / "s.yaml").write_text(said[said.index("\n\n") + 2:])
    found = scene.load(tmp_path / "s.yaml")
    assert found.section == "discrete" and found.values.materials[0].method == "query"
    with pytest.raises(RecipeError, match="earlier form"):
        (tmp_path / "s.yaml").write_text(HEAD + "asset: drops.h5\ndiscrete: {method: query}\n")
        scene.needs(tmp_path / "s.yaml")
