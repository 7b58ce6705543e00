"""The examples of docstrings run as they stand; they take NumPy and bakery from the reader."""

import doctest
from importlib import import_module

import numpy as np
import pytest

import bakery
from tests.conftest import MILK, ROOT

FINDER, PARSER = doctest.DocTestFinder(), doctest.DocTestParser()
MODULES = {path.relative_to(ROOT).as_posix().removesuffix(".py").removesuffix("/__init__").replace("/", "."): path
           for folder in ("bakery", "renderers") for path in sorted((ROOT / folder).rglob("*.py"))}
WITH_EXAMPLES = sorted(name for name, path in MODULES.items() if ">>> " in path.read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with what the examples name: the recipes, and a small fog.h5 of three wavelengths."""
    path = tmp_path_factory.mktemp("examples")
    (path / "recipes").symlink_to(ROOT / "recipes")
    (path / "fog.yaml").write_text(MILK.format(name="fog", g=0.5))
    bakery.bake(path / "fog.yaml", output=path / "fog.h5")
    return path


@pytest.mark.parametrize("name", WITH_EXAMPLES)
def test_examples(name, folder, monkeypatch):
    monkeypatch.chdir(folder)
    module = import_module(name)
    tests = [test for test in FINDER.find(module, name, extraglobs={"np": np, "bakery": bakery}) if test.examples]
    # none is hidden from doctest, such as by a decorator
    assert sum(len(test.examples) for test in tests) == MODULES[name].read_text(encoding="utf-8").count(">>> ")
    said: list[str] = []
    failed = sum(doctest.DocTestRunner(optionflags=doctest.ELLIPSIS).run(test, out=said.append).failed for test in tests)
    assert not failed, "".join(said)


def test_an_example_that_is_wrong_fails():
    test = PARSER.get_doctest(">>> 1 + 1\n3\n", {}, "wrong", None, None)
    assert doctest.DocTestRunner().run(test, out=lambda text: None).failed == 1
