"""Whatever a stranger sends: a clear error that names the line, no other exception, bounded work.

`recipes/NAME.yaml` must be refused with the message in `recipes/NAME.txt`, word for word; each fault that is found becomes a
pair of files.
"""

import os
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bakery.errors import RecipeError, UsageError
from bakery.recipe import load
from tests.conftest import ROOT, where_rights_bind

CORPUS = Path(__file__).parent / "recipes"
FOG, SAND = ((ROOT / "recipes" / f"{name}.yaml").read_text(encoding="utf-8") for name in ("fog", "sand"))
pytestmark = pytest.mark.timeout(60)


@pytest.fixture
def write(tmp_path):
    def write(data, name="fog.yaml"):
        path = tmp_path / name
        path.write_bytes(data if isinstance(data, bytes) else data.encode())
        return path

    return write


@pytest.mark.parametrize("path", sorted(CORPUS.glob("*.yaml")), ids=lambda path: path.stem)
def test_corpus(path, monkeypatch):
    monkeypatch.chdir(CORPUS)
    with pytest.raises(RecipeError) as error:
        load(path.name)
    assert str(error.value) + "\n" == path.with_suffix(".txt").read_text(encoding="utf-8")
    assert all(problem.found or problem.expected for problem in error.value.problems)


def test_messages_keep_control_characters_off_the_terminal():
    for path in CORPUS.glob("*.txt"):
        text = path.read_text(encoding="utf-8")
        assert all(c.isprintable() or c == "\n" for c in text), path


@pytest.mark.parametrize("data", [FOG.encode("utf-8-sig"), FOG.replace("\n", "\r\n").encode(), FOG.replace("\n", "\r").encode()],
                         ids=["BOM", "CRLF", "CR"])
def test_harmless_encodings_are_read(write, data):
    assert load(write(data)).particles.number_density == 1e8


def test_lines_are_right_after_crlf(write):
    with pytest.raises(RecipeError, match=r"fog.yaml:4: name"):
        load(write("\ufeff# fog\r\n\r\nbakery: 1\r\nname: ..\r\n"
                   "medium: {albedo: 1, mean_free_path: 1 m, phase: {type: isotropic}}\r\n"))


# ---- size


@pytest.mark.parametrize(
    "data, says",
    [
        (b"#" + b"x" * (10 << 20), "bytes; a recipe has at most"),
        ("a: [" + "1, " * 20_100 + "1]\n", "more than 20,000 values"),
        ("".join(f"k{i}: 1\n" for i in range(10_100)), "more than 20,000 values"),
        ("".join(f"k{i}: 1\n" for i in range(1_200)), "1,00[0-9] more problems follow"),
        ("[" * 500_000, "more than 32 levels"),
        ("{a: " * 200_000, "more than 32 levels"),
        ("- " * 500_000, "more than 32 levels"),
        ("\x01" * 500_000, "control character U[+]0001"),
        ("a: !" + "x" * 900_000, "recipes have no tags"),
        ("a: !<" + "%41" * 300_000 + ">", "recipes have no tags"),
        ("\n" * 900_000, "900,000 lines"),
        ("a: [1, 2] mm", "unknown key"),
        ("[1] mm, " * 100_000, "."),
        ("wavelengths: [" + "0.5, " * 5000 + "0.5]\n", "at most 4,096"),
        ("? " * 100_000, "."),
        ("a: '" + "'' " * 100_000, "."),
        ("bakery: [" + "1, " * 100_000, "."),
    ],
)
@pytest.mark.slow
def test_large_inputs(write, data, says):
    with pytest.raises(RecipeError, match=says):
        load(write(data))


def test_a_table_that_is_too_large(write, tmp_path):
    with open(tmp_path / "large.csv", "wb") as file:
        file.truncate((64 << 20) + 1)  # sparse
    with pytest.raises(RecipeError, match='"large.csv" of more than 64 MiB'):
        load(write(FOG.replace("material: water", "material: {file: large.csv}")))


def test_a_table_with_too_many_rows(write, tmp_path):
    (tmp_path / "long.csv").write_bytes(b"1,1\n" * 1_001_002)
    with pytest.raises(RecipeError, match="more than 1,000,000 rows"):
        load(write(FOG.replace("material: water", "material: {file: long.csv}")))


# ---- files


def test_no_recipe(tmp_path):
    os.mkfifo(tmp_path / "pipe.yaml")
    (tmp_path / "link.yaml").symlink_to("nowhere.yaml")
    (tmp_path / "loop.yaml").symlink_to("loop.yaml")
    for path, says in [
        (tmp_path / "none.yaml", "no such file"),
        (tmp_path, "found a folder"),
        (tmp_path / "pipe.yaml", "found a pipe"),
        ("/dev/zero", "found a device"),
        (tmp_path / "link.yaml", "no such file"),
        (tmp_path / "loop.yaml", "cannot be read"),
        (tmp_path / "fog.yaml" / "x", "no such file"),
        ("a\0b.yaml", "not a valid file name"),
        ("x" * 5000, "cannot be read"),
    ]:
        with pytest.raises(UsageError, match=says) as error:
            load(path)
        assert str(error.value).isprintable()


def test_tables_from_elsewhere(write, tmp_path):
    folder = tmp_path / "inside"
    folder.mkdir()
    (tmp_path / "secret.csv").write_text("0.3,1.3\n0.9,1.3\n")
    os.mkfifo(folder / "pipe.csv")
    (folder / "out.csv").symlink_to("../secret.csv")
    (folder / "folder").symlink_to("..")
    (folder / "zero.csv").symlink_to("/dev/zero")
    (folder / "loop.csv").symlink_to("loop.csv")
    (folder / "good.csv").write_text("0.3,1.3\n0.9,1.3\n")
    (folder / "within.csv").symlink_to("good.csv")
    for name, says in [
        ("out.csv", "leaves the recipe's folder"),
        ("folder/secret.csv", "leaves the recipe's folder"),
        ("zero.csv", "leaves"),
        ("pipe.csv", "found a pipe"),
        ("loop.csv", "cannot be read|no such file"),
        ("../secret.csv", "leaves"),
        ("../inside/../secret.csv", "leaves"),
        ("./../inside/good.csv/../../secret.csv", "leaves"),
        (".", "found a folder"),
    ]:
        path = write(FOG.replace("material: water", f"material: {{file: {name}}}"), "inside/fog.yaml")
        with pytest.raises(RecipeError, match=says):
            load(path)
    for name in ("good.csv", "within.csv", "../inside/good.csv", "materials/ice.csv"):
        recipe = load(write(FOG.replace("material: water", f"material: {{file: {name}}}"), "inside/fog.yaml"))
        assert recipe.files[-1].key == "particles.components[0].material.file"


def test_unreadable_files():
    text = FOG.replace("material: water", "material: {file: own.csv}")

    def check(folder):
        recipe, table = folder / "fog.yaml", folder / "own.csv"
        recipe.write_text(text)
        table.write_text("0.3,1.3\n0.9,1.3\n")
        load(recipe)
        table.chmod(0)
        with pytest.raises(RecipeError, match="cannot be read"):
            load(recipe)
        recipe.chmod(0)
        with pytest.raises(UsageError, match="cannot be read"):
            load(recipe)

    where_rights_bind(check)


# ---- anything at all


def refused_or_read(path, overrides=None):
    try:
        recipe = load(path, overrides)
    except (RecipeError, UsageError) as error:
        assert str(error)
        assert all(c.isprintable() or c == "\n" for c in str(error)), repr(str(error))
    else:
        assert recipe.leaves["bakery"] == 1


_quiet = settings(max_examples=40, deadline=None, derandomize=True, database=None,
                  suppress_health_check=[HealthCheck.function_scoped_fixture])


@_quiet
@given(data=st.one_of(st.binary(max_size=200), st.text(max_size=200).map(lambda text: text.encode("utf-8", "surrogatepass")),
                      st.text(alphabet="ab:-[]{}\"'#&*!|>%@`, \n\t?1.<", max_size=60).map(str.encode)))
def test_any_bytes(write, data):
    refused_or_read(write(data))


_words = st.sampled_from(["", "[", "]", "{", "}", ":", "- ", "? ", "|", ">", "&a ", "*a", "!!x ", "'", '"', "#", "\t", "\n", "<<",
                          "~", "null", ".nan", "-1", "1e400", "1e-400 um", "9" * 30, "5", "5 um", "[1, 2] mm", "[1, 2 mm", "%",
                          "µm", "water", "mixture", "table", "goa", "inf", "mesh", "sphere", "conductor", "../x", "rgb",
                          "[0.5, 0.6]", "{n: 1.3}", "{file: x.csv}", "of", "min", "medium", "0", "\x00", "\x85", "\u2028", "é",
                          "\U0001f600"])


@_quiet
@given(good=st.sampled_from([FOG, SAND]), edits=st.lists(st.tuples(st.floats(0, 1), st.integers(0, 12), _words), min_size=1,
                                                         max_size=4))
def test_any_edit_of_a_good_recipe(write, good, edits):
    text = "\n".join(line for line in good.splitlines() if not line.startswith("#"))
    for where, cut, word in edits:
        at = int(where * len(text))
        text = text[:at] + word + text[at + cut :]
    refused_or_read(write(text))


_keys = st.one_of(st.sampled_from(["seed", "tolerance", "wavelengths", "particles.components[0].size",
                                   "particles.components.droplets.material", "phase.method", "particles.components", "particles",
                                   "name.x", "a.b.c", "particles.components[9]", "[0]", "", ".", "a..b"]), st.text(max_size=12))


@_quiet
@given(overrides=st.dictionaries(_keys, st.one_of(_words, st.text(max_size=20)), max_size=3))
def test_any_override(overrides):
    refused_or_read(ROOT / "recipes" / "fog.yaml", overrides)
