"""The layers of docs/architecture.md, kept by reading every import statement."""

from __future__ import annotations

import ast
import subprocess
import sys

import pytest

from tests.conftest import ROOT

PHYSICS = {"averages", "beam", "goa", "grains", "mie", "sizes", "materials", "medium", "multiple", "packing"}
# folder -> what it may import of bakery, besides itself and `errors`
MAY = {
    "recipe": {"grains.limits", "materials", "packing", "sizes"},
    "plan": {"recipe", "stages", "store.tree"},
    "stages": PHYSICS | {"store.tree", "recipe"},
    "trade": {"plan", "recipe", "report", "run", "stages", "store"},
    "run": {"machine", "plan", "recipe", "stages", "store", "__version__"},
    "store": set(),
    "report": {"__version__", "asset", "beam", "medium", "multiple", "packing", "stages", "store", "recipe.units"},
    "export": {"asset", "medium", "report", "store"},
} | {folder: PHYSICS for folder in PHYSICS} | {"grains": PHYSICS | {"llvm"}}
OUTSIDE = {"numpy", "scipy", "numba", "math", "cmath", "functools", "dataclasses", "collections", "typing", "__future__",
           "array", "hashlib", "inspect", "itertools", "os", "pathlib", "llvmlite", "concurrent", "csv", "sys", "threading",
           "operator", "heapq", "time"}
# the second engine: what it imports it imports when it is asked for, and no other physics does
ENGINE = {"bakery/grains/mitsuba_walk.py": {"mitsuba", "drjit"}}
# scenes are written, and refused, as recipes are: who reads them shares the grammar of recipes
SCENES = {"renderers/scene.py", "renderers/native/screen/scene.py"}


def modules(folder: str):
    return sorted((ROOT / folder).rglob("*.py"))


def imports(path):
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            for alias in node.names:
                yield f"{node.module}.{alias.name}"


def below(name: str, allowed) -> bool:
    return any(name == top or name.startswith(top + ".") for top in allowed)


@pytest.mark.parametrize("folder", sorted(MAY))
def test_imports_point_down(folder):
    paths = modules(f"bakery/{folder}")
    assert paths
    for path in paths:
        for name in imports(path):
            if name.startswith("bakery."):
                assert below(name.removeprefix("bakery."), MAY[folder] | {folder, "errors"}), f"{path} imports {name}"
            assert not name.startswith("renderers"), f"{path} imports {name}"


@pytest.mark.parametrize("folder", sorted(PHYSICS))
def test_physics_knows_arrays_only(folder):
    for path in modules(f"bakery/{folder}"):
        for name in imports(path):
            known = OUTSIDE | ENGINE.get(str(path.relative_to(ROOT)), set())
            assert name.startswith("bakery.") or name.split(".")[0] in known, f"{path} imports {name}"


@pytest.mark.parametrize("place", sorted(ENGINE))
def test_engines_are_imported_in_functions(place):
    for node in ast.parse((ROOT / place).read_text()).body:
        assert not any(name.split(".")[0] in ENGINE[place] for name in imported(node)), f"{place}:{node.lineno}"


def imported(node):
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    return [node.module] if isinstance(node, ast.ImportFrom) else []


def test_renderers_see_assets_only():
    for path in modules("renderers"):
        for name in imports(path):
            if name.startswith("bakery"):
                allowed = name in {"bakery", "bakery.open"} or name.startswith(("bakery.errors", "bakery.llvm", "bakery.machine",
                                                                                          "bakery.store.outputs"))
                allowed = allowed or (str(path.relative_to(ROOT)) in SCENES and name.startswith("bakery.recipe."))
                assert allowed, f"{path} imports {name}"


def test_import_and_help_load_nothing_heavy():
    code = ("import sys, bakery, bakery.cli\n"
            "from bakery.cli import status_of\n"
            "status_of(['--help'])\n"
            "heavy = {'numpy', 'numba', 'scipy', 'h5py', 'matplotlib', 'pydantic', 'rich', 'mitsuba'} & set(sys.modules)\n"
            "assert not heavy, heavy\n")
    subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT, stdout=subprocess.DEVNULL)
