"""`bake inspect` and `bake report`: what an asset holds, on any terminal."""

import json
import os
import subprocess
import sys
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

import bakery
from bakery.store.tree import Dataset, Group, text
from bakery.store.write import write
from tests.conftest import ROOT, slow
from tests.samples import small_asset, with_member

HOSTILE = '<script>alert("x")</script>\x1b[2J'


@pytest.fixture
def fog(tmp_path):
    path = tmp_path / "fog.h5"
    write(path, small_asset())
    return path


@pytest.fixture
def hostile(tmp_path):
    """Texts from a stranger in every place that the format leaves free."""
    root = small_asset()
    root = with_member(root, "recipe", text(f"name: fog\n# {HOSTILE}\n", "the recipe"))
    root = with_member(root, "medium/g", replace(root["medium/g"], description=HOSTILE))
    medium = root["medium"]
    root = with_member(root, "medium", Group(medium.members, medium.attributes | {"error_measure": HOSTILE}))
    root = with_member(root, "provenance", Group(root["provenance"].members, {"command": HOSTILE}))
    root = with_member(root, "optics", None)  # leaves few pictures to draw
    path = tmp_path / "hostile.h5"
    write(path, Group(root.members, root.attributes | {"name": HOSTILE}))
    return path


def test_every_member_stands_in_the_tree_with_its_shape_range_and_unit(call, fog):
    status, out, _ = call("inspect", fog)
    assert status == 0
    lines = {line.lstrip("├└│─ ").split()[0]: line for line in out.split("\n\n")[0].splitlines()[1:]}
    root = small_asset()
    assert set(lines) == {path.rpartition("/")[2] for path, _ in root.walk()}
    assert "2 x 60" in lines["extinction"] and "um^2" in lines["extinction"] and "120 mie" in lines["method"]
    assert "0.61 0.465 um" in lines["wavelength"] and "0 .. 3.14159 rad" in lines["theta"]
    assert "+- 0.01 %" in lines["scattering"]  # from scattering_error, 1e-4 of it
    for said in ("stage optics, version 1; this bakery writes version ", "error 0.004 of 0.01", "content_hash names",
                 "largest relative change of a coefficient", "input_hash names", "bake fog.yaml", "2026-01-01"):
        assert said in out, said


def test_a_path_shows_what_lies_below_it(call, fog):
    status, out, _ = call("inspect", fog, "optics/droplets/radius")
    assert status == 0 and "radius" in out and "sigma_t" not in out and "weight" not in out and "provenance" not in out
    status, out, err = call("inspect", fog, "medium/fase")
    assert status == 2 and not out and "did you mean medium/phase?" in err


def test_json_says_the_same(call, fog):
    status, out, _ = call("inspect", fog, "--json")
    found = json.loads(out)
    root = small_asset()
    assert status == 0 and found["bytes"] == fog.stat().st_size
    assert found["members"] == [path for path, _ in root.walk()]
    for row in found["datasets"]:
        data = root[row["path"]].data
        assert row["shape"] == list(data.shape) and row["units"] == root[row["path"]].units
        if row["minimum"] is not None:
            assert (row["minimum"], row["maximum"]) == (data.min(), data.max())
    assert [stage["stage"] for stage in found["stages"]] == ["optics", "medium"]
    assert found["stages"][0]["seconds"] == 1.5 and found["stages"][0]["notes"] == ["none"]


@pytest.mark.usefixtures("verified_here")
def test_nothing_is_written(call, milk):
    """Read-only commands leave no trace, not even a time stamp."""
    asset = milk.with_suffix(".h5")
    assert call(milk, "-o", asset)[0] == 0
    before, beside = asset.stat(), sorted(milk.parent.iterdir())
    os.chmod(milk.parent, 0o500)
    try:
        for args in (("inspect", asset), ("query", asset, "medium/g"), ("diff", asset, asset), ("verify", asset)):
            assert call(*args)[0] == 0, args
    finally:
        os.chmod(milk.parent, 0o700)
    after = asset.stat()
    assert (before.st_mtime_ns, before.st_ino) == (after.st_mtime_ns, after.st_ino) and sorted(milk.parent.iterdir()) == beside


def test_foreign_damaged_and_missing_files_end_in_one_message(call, fog, tmp_path):
    (tmp_path / "text.h5").write_text("hello")
    damaged = bytearray(fog.read_bytes())
    damaged[-1000] ^= 1
    (tmp_path / "damaged.h5").write_bytes(damaged)
    cases = (("text.h5", "not a bakery asset"), ("damaged.h5", "damaged"), ("none.h5", "no such file"), (".", "folder"))
    for name, said in cases:
        for args in (("inspect", tmp_path / name), ("query", tmp_path / name, "medium/g"), ("plot", tmp_path / name),
                     ("report", tmp_path / name), ("export", tmp_path / name, "--to", "csv")):
            status, out, err = call(*args)
            assert status == 2 and not out and said in err and len(err.splitlines()) == 1, (args, err)


def test_control_characters_do_not_reach_the_terminal(call, hostile):
    out = call("inspect", hostile)[1] + call("query", hostile, "medium/error_measure")[1]
    assert "\x1b" not in out and "\\x1b[2J" in out


@pytest.mark.parametrize("encoding", ["ascii", slow("utf-8")])
def test_any_encoding(fog, encoding):
    done = subprocess.run([sys.executable, "-m", "bakery", "inspect", str(fog)], capture_output=True, check=True,
                          env=os.environ | {"PYTHONPATH": str(ROOT), "PYTHONIOENCODING": encoding, "COLUMNS": "1"})
    text = done.stdout.decode(encoding)
    assert ("└─ " in text) == (encoding == "utf-8") and ("`- " in text) == (encoding != "utf-8")
    assert not complaints(done.stderr.decode())


def complaints(stderr: str) -> list[str]:
    """Its lines besides the one by which a command says on a busy machine that it is at work."""
    return [line for line in stderr.splitlines() if not line.endswith(" s so far")]


def test_a_reader_that_goes_away_is_no_error(fog):
    shell = f"{sys.executable} -m bakery query {fog} medium/phase | head -n 1; echo ${{PIPESTATUS[0]}}"
    done = subprocess.run(["bash", "-c", shell], capture_output=True, text=True, check=True,
                          env=os.environ | {"PYTHONPATH": str(ROOT)})
    assert done.stdout.splitlines()[-1] == "0" and not complaints(done.stderr)


@pytest.mark.slow
def test_a_narrow_terminal_gets_short_lines_and_every_word(call, fog):
    """In pseudo-terminals of 20 and 80 columns lines go on below themselves; nothing of what others get is lost, long words stay
    whole."""
    import pty

    def lines(columns: str) -> list[str]:
        ours, theirs = pty.openpty()
        around = os.environ | {"PYTHONPATH": str(ROOT), "COLUMNS": columns, "PYTHONIOENCODING": "utf-8"}
        with subprocess.Popen([sys.executable, "-m", "bakery", "inspect", str(fog), "medium/g"], stdout=theirs,
                              stderr=subprocess.DEVNULL, env=around) as child:
            os.close(theirs)
            out = b""
            try:
                while part := os.read(ours, 4096):
                    out += part
            except OSError:
                pass  # the other end is closed
            os.close(ours)
        assert child.returncode == 0
        return out.decode().splitlines()

    wide = call("inspect", fog, "medium/g")[1].splitlines()
    words = " ".join(wide).split()
    for columns in (1, 80):
        found = lines(str(columns))
        assert all(len(line) <= max(columns, 20) or len(line.split()) == 1 for line in found)
        assert " ".join(found).split() == words
    assert max(map(len, wide)) > 80


class Page(HTMLParser):
    """Collects what matters of a page: tags, the addresses that it names, the text."""

    def __init__(self, content: str):
        super().__init__()
        self.tags, self.addresses, self.open, self.text = [], [], [], ""
        self.feed(content)

    def handle_starttag(self, tag, attributes):
        self.tags.append(tag)
        self.addresses += [value for name, value in attributes if name in ("src", "href", "action", "data", "srcset")]
        if tag not in ("meta", "img", "link", "br"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text += data


def test_the_page_is_whole_and_self_contained(call, fog):
    write(fog, with_member(small_asset(), "optics", None))  # three pictures
    status, out, _ = call("report", fog, "--json", "--no-render")
    page = fog.with_suffix(".html")
    assert status == 0 and json.loads(out) == {"file": str(page), "bytes": page.stat().st_size}
    found = Page(page.read_text())
    assert not found.open and found.tags.count("img") >= 3
    assert found.addresses and all(address.startswith(("data:image/svg+xml;base64,", "data:image/png;base64,"))
                                   for address in found.addresses)
    assert "No rendered picture: bake render fog.h5" in found.text and "Tolerance missed" not in found.text
    g = small_asset()["medium/g"].data
    for said in ("sigma_t (1/m)", "# a comment as people write them", "bake fog.yaml", f"{g[0]:.6g}"):
        assert said in found.text, said


def test_what_stands_on_top_of_the_page(call, undrawn, tmp_path):
    """The recipe's description, the preview of exactly this asset, a mark at each stage that missed its tolerance."""
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    root = with_member(small_asset(), "recipe", text("bakery: 1\ndescription: Fog & <dew>\n", "the recipe"))
    medium = root["medium"]
    root = with_member(root, "medium", Group(medium.members, medium.attributes | {"achieved_error": 0.033}))
    root = with_member(root, "optics", None)
    write(tmp_path / "fog.h5", root)
    content = json.loads(call("inspect", tmp_path / "fog.h5", "--json")[1])["content_hash"]
    pages = []
    for of in (content, "0" * 64):  # the second preview is another asset's
        info = PngInfo()
        info.add_text("bakery content_hash", f'"{of}"')
        Image.new("RGB", (320, 200), "gray").save(tmp_path / "fog.png", pnginfo=info)
        assert call("report", tmp_path / "fog.h5", "--no-render")[0] == 0
        pages.append((tmp_path / "fog.html").read_text())
    found = Page(pages[0])
    assert found.text.index("Fog & <dew>") < found.text.index("Medium")
    assert "Tolerance missed. medium: its error is 0.033, above the tolerance of 0.01" in found.text
    assert found.text.count("0.033 missed") == 1 and 'class="n missed">0.033 missed' in pages[0]
    assert ["data:image/jpeg" in page for page in pages] == [True, False] and "No rendered picture" in pages[1]
    (tmp_path / "fog.png").write_bytes(b"no picture")
    assert call("report", tmp_path / "fog.h5", "--no-render")[0] == 0


def test_a_page_renders_its_own_picture(call, undrawn, fog, tmp_path, monkeypatch):
    """Where none of this very asset lies beside it: a draft, of which nothing stays."""
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    import renderers.preview

    asked = []

    def preview(path, target, quality):
        asked.append((str(path), quality))
        info = PngInfo()
        info.add_text("bakery content_hash", bakery.open(path).content_hash)
        Image.new("RGB", (320, 200), "gray").save(target, pnginfo=info)

    monkeypatch.setattr(renderers.preview, "preview", preview)
    before = set(fog.parent.iterdir())
    assert call("report", fog, "-o", tmp_path / "fog.html")[0] == 0
    assert asked == [(str(fog), "draft")] and "data:image/jpeg" in (tmp_path / "fog.html").read_text()
    assert set(fog.parent.iterdir()) - before == {tmp_path / "fog.html"}
    assert call("report", fog, "-o", tmp_path / "fog.html", "--no-render")[0] == 0
    assert len(asked) == 1 and "No rendered picture" in (tmp_path / "fog.html").read_text()


@pytest.mark.slow
def test_texts_of_strangers_stay_texts(call, hostile, tmp_path):
    status, out, _ = call("report", hostile, "-o", tmp_path / "x.html", "--no-render")
    assert status == 0 and out == f"{tmp_path / 'x.html'}\n"
    found = Page((tmp_path / "x.html").read_text())
    assert "script" not in found.tags and HOSTILE.split("\x1b")[0] in found.text
    assert call("report", hostile, "-o", tmp_path, "--no-render")[0] == 2
    assert call("report", hostile, "-o", tmp_path / "no" / "x.html", "--no-render")[0] == 2


def test_an_asset_of_other_stages_is_shown_too(call, tmp_path):
    """Groups that no declaration of this version speaks of, values that are not finite."""
    root = small_asset()
    odd = Group({"centers": Dataset(np.zeros((5, 3)), "1", "centres"), "r": Dataset(np.array([np.nan, 1.0]), "1", "distance")},
                root["medium"].attributes | {"stage": "shards"})
    path = tmp_path / "odd.h5"
    write(path, Group({"recipe": root["recipe"], "wavelength": root["wavelength"], "shards": odd, "provenance": Group()},
                      root.attributes))
    status, out, _ = call("inspect", path)
    assert status == 0 and "5 x 3" in out and "nan" in out
    assert json.loads(call("inspect", path, "--json")[1])["datasets"][3]["minimum"] is None
    assert call("report", path, "--no-render")[0] == 0
    assert "holds nothing to draw" in call("plot", path)[2]
    assert "holds no stage `medium`" in call("export", path, "--to", "mitsuba")[2]
    assert call("query", path, "shards/centers")[0] == 0
