"""The layers of docs/architecture.md, kept by reading every import statement."""

from __future__ import annotations

import ast
import subprocess
import sys

import pytest

from tests.conftest import ROOT

# folder -> what it may import of bakery, besides itself and `errors`
MAY = {
    "system": set(),
    "grammar": set(),
    "physics": {"rng", "system.llvm"},
    "store": set(),
    "draw": {"physics.medium", "store.tree"},
    "stages": {"asset.axes", "asset.lookup", "draw", "grammar", "physics", "report.figures", "rng", "store", "system.terminal"},
    "recipe": {"grammar", "physics", "stages"},
    "plan": {"recipe", "stages", "store.tree"},
    "asset": {"physics.medium", "stages", "store"},
    "report": {"__version__", "asset", "draw", "physics.medium", "stages", "store", "system.terminal"},
    "export": {"asset", "draw", "physics", "report", "stages", "store", "system.terminal"},
    "run": {"__version__", "plan", "recipe", "stages", "store", "system"},
    "trade": {"draw", "plan", "recipe", "report", "run", "stages", "store", "system"},
}
OUTSIDE = {"numpy", "scipy", "numba", "math", "cmath", "functools", "dataclasses", "collections", "typing", "__future__",
           "array", "hashlib", "inspect", "itertools", "os", "pathlib", "llvmlite", "concurrent", "csv", "sys", "threading",
           "operator", "heapq", "re", "time"}
# what these import they import when they are asked for, and no other physics does
ENGINE = {"bakery/physics/grains/mitsuba_walk.py": {"mitsuba", "drjit"}, "bakery/physics/shapes/mending.py": {"trimesh"},
          "bakery/physics/shapes/repair.py": {"pymeshlab"}}
# what renderers see of bakery: assets, kernels for their own loops, the grammar of scenes, and what the machine offers
SEEN = {"bakery", "bakery.open"}, ("bakery.errors", "bakery.grammar", "bakery.kernels", "bakery.store.outputs",
                                   "bakery.store.ply", "bakery.system")
# what renderers share, from the ground up: each part with what it may import of the others.  Renderers may import all of it,
# and nothing of each other
SHARED = {"camera": set(), "colour": set(), "inputs": set(), "progress": set(), "images": {"colour"}, "scene": {"inputs"},
          "mitsuba": {"camera", "colour", "images", "inputs"}, "running": {"images", "mitsuba", "progress", "scene"}}


def modules(folder: str):
    return sorted((ROOT / folder).rglob("*.py"))


def imports(path):
    tree = ast.parse(path.read_text())
    # for type checkers alone
    unseen = {inner for node in ast.walk(tree) if isinstance(node, ast.If) and getattr(node.test, "id", "") == "TYPE_CHECKING"
              for inner in ast.walk(node)}
    for node in ast.walk(tree):
        if node in unseen:
            continue
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


def test_physics_knows_arrays_only():
    for path in modules("bakery/physics"):
        for name in imports(path):
            known = OUTSIDE | ENGINE.get(str(path.relative_to(ROOT)), set())
            assert name.startswith("bakery.") or name.split(".")[0] in known, f"{path} imports {name}"


def test_no_circles_in_physics():
    """File by file: those that import none of the others are taken away, until nothing is left."""
    files = {".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path
             for path in modules("bakery/physics")}
    needs = {}
    for module, path in files.items():
        named = set(imports(path))
        needs[module] = {other for other in files if other != module and (other in named or any(
            name.rpartition(".")[0] == other and name not in files for name in named))}
    while needs:
        free = [module for module, others in needs.items() if not others & needs.keys()]
        assert free, f"circle among {sorted(needs)}"
        for module in free:
            del needs[module]


@pytest.mark.parametrize("place", sorted(ENGINE))
def test_engines_are_imported_in_functions(place):
    for node in ast.parse((ROOT / place).read_text()).body:
        assert not any(name.split(".")[0] in ENGINE[place] for name in imported(node)), f"{place}:{node.lineno}"


def imported(node):
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    return [node.module] if isinstance(node, ast.ImportFrom) else []


def test_renderers_see_assets_kernels_and_the_grammar_only():
    exact, beginnings = SEEN
    for path in modules("renderers") + modules("tests/toy_renderer"):
        for name in imports(path):
            if name.startswith("bakery"):
                assert name in exact or name.startswith(beginnings), f"{path} imports {name}"


def test_renderers_stand_on_what_they_share():
    for path in modules("renderers"):
        if path.name == "__main__.py":
            continue  # a program, which nothing imports
        part = path.relative_to(ROOT / "renderers").with_suffix("").parts[0]
        for name in imports(path):
            if name.startswith("renderers."):
                assert below(name.removeprefix("renderers."), SHARED.get(part, set(SHARED)) | {part}), f"{path} imports {name}"


def test_import_and_help_load_nothing_heavy():
    code = ("import sys, bakery, bakery.cli\n"
            "from bakery.cli import status_of\n"
            "status_of(['--help'])\n"
            "heavy = {'numpy', 'numba', 'scipy', 'h5py', 'matplotlib', 'pydantic', 'rich', 'mitsuba', 'trimesh'}\n"
            "heavy &= set(sys.modules)\n"
            "assert not heavy, heavy\n")
    subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT, stdout=subprocess.DEVNULL)
