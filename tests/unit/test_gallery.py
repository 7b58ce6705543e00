"""The page of all recipes and scenes: each is on it, with a picture or what makes one; texts stay texts."""

import runpy

from tests.conftest import ROOT

PROGRAM = str(ROOT / "docs/pictures/gallery.py")


def test_every_recipe_and_scene_is_on_the_page(tmp_path, monkeypatch):
    program = runpy.run_path(PROGRAM)
    monkeypatch.setitem(program["main"].__globals__, "reduced", lambda place, width: b"\xff\xd8" + place.stem.encode())
    program["main"](tmp_path / "gallery.html")
    text = (tmp_path / "gallery.html").read_text(encoding="utf-8")
    for folder in ("recipes", "assets/scenes", "docs/pictures"):
        for path in (ROOT / folder).glob("*.yaml"):
            assert f"<code>{folder}/{path.name}</code></figcaption>" in text
    assert text.count("<figure>") == text.count('<img alt=') > 60 and "No picture yet" not in text
    assert "in the scene lamp_in_dust" in text and "href" not in text


def test_what_has_no_picture_says_what_makes_one(tmp_path, monkeypatch):
    program = runpy.run_path(PROGRAM)
    monkeypatch.setitem(program["main"].__globals__, "_picture", lambda name, build: b"")
    program["main"](tmp_path / "gallery.html")
    text = (tmp_path / "gallery.html").read_text(encoding="utf-8")
    for command in ("bake recipes/milk.yaml -o build/milk.h5 &amp;&amp; bake render build/milk.h5",
                    "bake render assets/scenes/candle.yaml -o build/candle.png",
                    "bake render assets/scenes/night_street.yaml -o build/night_street.png"):
        assert f"<code>{command}</code>" in text


def test_texts_of_files_stay_texts():
    program = runpy.run_path(PROGRAM)
    page, Entry = program["page"], program["Entry"]
    text = page("A & B", "<lead>", {"one": [Entry("a<b", "<script>", "p&q", "make <c>", b"")], "two": []})
    assert "<script>" not in text and "a&lt;b" in text and "p&amp;q" in text and "make &lt;c&gt;" in text and "two" not in text
