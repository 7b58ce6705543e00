"""The distribution's name: `bakery` on the package index is somebody else's, so nothing may tell a user to install it."""

import re
import tomllib

import pytest

from tests.conftest import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
EXTRAS = set(PROJECT["optional-dependencies"])
# the name with an extra behind it, behind `pip install` or quoted as a distribution's whose version is asked for
FOREIGN = re.compile(
    rf"(?<![\w.-])bakery\[\W*({'|'.join(EXTRAS)})|\bpip3?\b[^\n`]*\binstall\b[^\n`#]*[\s'\"]bakery(?!\\?'s|[\w./-])"
    r"|\b(version|metadata|distribution|requires)\(\s*[\"']bakery[\"']"
)
TEXTS = sorted(path for name in ("bakery", "renderers", "docs", "recipes", "assets", "benchmarks", ".ci")
               for path in (ROOT / name).rglob("*") if path.is_file() and path.suffix in ("", ".py", ".md", ".yaml", ".csv"))
TEXTS += [ROOT / name for name in ("README.md", "Makefile", "pyproject.toml")]


def test_name_is_not_the_one_that_is_taken():
    assert PROJECT["name"] == "bakery-scattering" and PROJECT["scripts"] == {"bake": "bakery.cli:main"}


@pytest.mark.parametrize("text, wrong", [
    ('pip install "bakery[mitsuba,llvm]"', True),
    ("get it by: pip install bakery", True),
    ("pip3 install --upgrade 'bakery'", True),
    ("python -m pip install bakery[test]", True),
    ('version("bakery")', True),
    ('pip install ".[mitsuba,llvm]" in the folder of bakery\'s sources', False),
    ("pip install . # bakery", False),
    ("pip install ./bakery", False),
    ("pip install bakery-scattering", False),
    ("bakery.__version__", False),
])
def test_the_pattern_knows_the_wrong_spelling(text, wrong):
    assert bool(FOREIGN.search(text)) is wrong


def test_nothing_names_the_foreign_distribution():
    assert len(TEXTS) > 300
    found = [f"{path.relative_to(ROOT)}: {match.group()}" for path in TEXTS if (match := FOREIGN.search(path.read_text()))]
    assert not found


def test_every_extra_that_is_named_exists():
    named = {extra for path in TEXTS for match in re.findall(r"\binstall\b[^\n]*?\.\[([a-z,]+)\]", path.read_text())
             for extra in match.split(",")}
    assert {"mitsuba", "llvm", "cluster"} <= named
    assert named <= EXTRAS
