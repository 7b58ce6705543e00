"""The layers of docs/architecture.md, kept by reading every import statement."""

import ast
import gc
import re
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

from tests.conftest import ROOT

# folder -> what it may import of bakery, besides itself and `errors`
MAY = {
    "system": set(),
    "grammar": set(),
    "physics": {"rng", "system.compiled", "system.llvm", "system.memory"},
    "store": {"system.memory"},
    "draw": {"store.put"},
    "stages": {"draw", "grammar", "physics", "rng", "store", "system.terminal"},
    "family": {"draw", "grammar", "physics.medium", "stages", "store"},
    "recipe": {"family.axes", "grammar", "physics", "stages"},
    "plan": {"stages"},
    "asset": {"draw", "family", "grammar", "physics.medium", "stages", "store"},
    "report": {"asset", "draw", "family", "stages", "store", "system.terminal"},
    "export": {"asset", "draw", "grammar", "physics", "report", "stages", "store", "system.terminal"},
    "run": {"asset", "family", "grammar.files", "grammar.qualities", "plan", "recipe", "stages", "store", "system"},
    "starting": {"draw", "grammar", "physics", "recipe", "run", "store"},
    "trade": {"draw", "grammar.qualities", "plan", "recipe", "run", "stages", "store", "system"},
    "scenes": {"draw", "grammar", "plan", "report", "run", "store", "trade"},
}
# of these alone renderers are seen, from outside: the commands have them besides
WITH_RENDERERS = {"scenes": ("renderers.choice", "renderers.pictures", "renderers.scene")}
OUTSIDE = {"numpy", "scipy", "numba", "math", "cmath", "functools", "dataclasses", "collections", "typing", "__future__",
           "array", "contextlib", "copy", "hashlib", "inspect", "itertools", "os", "pathlib", "llvmlite", "concurrent", "csv",
           "sys", "threading", "operator", "heapq", "re", "time"}
# what these import they import when they are asked for, and no other physics does
ENGINE = {"bakery/physics/multiple/symbolic.py": {"drjit"},
          "bakery/physics/sizes/distributions.py": {"importlib"}, "bakery/physics/shapes/repair.py": {"pymeshlab"}}
# what renderers see of bakery: assets, kernels for their own loops, the grammar of scenes, and what the machine offers
SEEN = {"bakery", "bakery.open"}, ("bakery.errors", "bakery.grammar", "bakery.kernels", "bakery.store.outputs",
                                   "bakery.store.ply", "bakery.store.put", "bakery.store.scratch", "bakery.system")
# where the recipe of a scene becomes its asset, what is kept beside it, and where it is known which kernels are met
BAKES = {"renderers/scene/assets.py": ("bakery.run.ensure",),
         "renderers/choice/remembered.py": ("bakery.run.cache", "bakery.store.tree"),
         "renderers/pictures/passes.py": ("bakery.run.ahead",),
         "renderers/sequence/__init__.py": ("bakery.run.progress",)}
# rooms of renderers, from the ground up: each with what it may import of the others
ROOMS = {"camera": set(), "colour": set(), "progress": set(), "seeds": set(), "threads": set(),
         "scene": {"mitsuba", "transport.solids"},
         "mitsuba": {"camera", "colour", "pictures.engine", "pictures.images", "pictures.reached", "scene.inputs", "seeds",
                     "threads"},
         "pictures": {"choice", "colour", "mitsuba", "progress", "scene", "seeds", "threads"},
         "choice": {"colour", "mitsuba", "pictures", "scene"},
         "cluster": {"pictures", "scene"},
         "sequence": {"choice", "cluster", "colour", "mitsuba", "pictures", "scene", "seeds"},
         "transport": {"colour", "mitsuba", "pictures.denoise", "pictures.engine", "threads"},
         "fog": {"camera", "colour", "mitsuba", "pictures", "progress", "scene", "threads"},
         "preview": {"camera", "colour", "mitsuba", "pictures", "progress", "threads", "transport.wavefront"}}
GROUND = {"camera", "choice", "colour", "mitsuba", "pictures", "progress", "scene", "seeds", "threads", "transport"}
# materials stand on all of that and know nothing of each other, but that a medium fills bodies, and that bodies and grains are
# surfaces far away; `mixed` knows all of them
MATERIALS = {"medium": set(), "particles": set(), "surface": set(), "grains": {"materials.surface"},
             "bodies": {"materials.medium", "materials.surface"}}


LATER = re.compile(r"((?:bakery|renderers)(?:\.\w+)+):\w+")  # a place that is imported when it is asked for


def modules(folder: str):
    return sorted((ROOT / folder).rglob("*.py"))


@cache
def tree(path) -> ast.Module:
    return ast.parse(path.read_text())


@pytest.fixture(autouse=True, scope="module")
def _trees():
    """No collection of garbage, which takes twice as long as parsing, and no trees for later tests: a million objects that every
    render of theirs would look through."""
    gc.disable()
    yield
    tree.cache_clear()
    gc.enable()


@cache
def imports(path) -> tuple[str, ...]:
    """What a module imports: `package.module`, and `module.name` of `from module import name`; not for type checkers alone."""
    return tuple(_imports(path, tree(path)))


def _imports(path, node):
    waiting = list(ast.iter_child_nodes(node))
    while waiting:
        inner = waiting.pop()
        if isinstance(inner, ast.If) and getattr(inner.test, "id", "") == "TYPE_CHECKING":
            continue
        if isinstance(inner, ast.Import):
            yield from (alias.name for alias in inner.names)
        elif isinstance(inner, ast.ImportFrom):
            assert inner.level == 0, f"{path}: relative import"
            yield from (f"{inner.module}.{alias.name}" for alias in inner.names)
        elif isinstance(inner, ast.Constant) and isinstance(inner.value, str) and (place := LATER.fullmatch(inner.value)):
            yield place[1]
        else:
            waiting.extend(ast.iter_child_nodes(inner))


def below(name: str, allowed) -> bool:
    return any(name == top or name.startswith(top + ".") for top in allowed)


def graph(root: Path, folders) -> dict[str, set[str]]:
    """Module -> the modules that it imports, in functions too; a package stands for its `__init__`."""
    paths = {".".join(path.relative_to(root).with_suffix("").parts).removesuffix(".__init__"): path
             for folder in folders for path in (root / folder).rglob("*.py")}
    # `from package import name` is the module package.name, where there is one, or else the package itself
    return {module: {found for name in imports(path) if (found := name if name in paths else name.rpartition(".")[0]) in paths}
            - {module} for module, path in paths.items()}


def circles(edges) -> list[list[str]]:
    """Modules that import each other, over any number of others (Tarjan's strongly connected components of several)."""
    number, lowest, waiting, found = {}, {}, [], []

    def visit(module):
        number[module] = lowest[module] = len(number)
        waiting.append(module)
        for other in edges[module]:
            if other not in number:
                visit(other)
                lowest[module] = min(lowest[module], lowest[other])
            elif other in waiting:
                lowest[module] = min(lowest[module], number[other])
        if lowest[module] == number[module]:
            at = waiting.index(module)
            found.append(sorted(waiting[at:]))
            del waiting[at:]

    for module in edges:
        if module not in number:
            visit(module)
    return [each for each in found if len(each) > 1]


def test_no_modules_import_each_other():
    edges = graph(ROOT, ("bakery", "renderers"))
    assert len(edges) > 200
    assert circles(edges) == []


@pytest.mark.parametrize("text, found", [
    ("from bakery.far import end\n", True),
    ("def f():\n    import bakery.far.end\n", True),
    ("f = later('bakery.far.end:f')\n", True),
    ("from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from bakery.far import end\n", False),
])
def test_a_circle_is_found(tmp_path, text, found):
    for name, content in {"near": text, "far/__init__": "", "far/middle": "from bakery import near\n",
                          "far/end": "from bakery.far.middle import near\n"}.items():
        path = tmp_path / "bakery" / f"{name}.py"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(content)
    assert circles(graph(tmp_path, ["bakery"])) == [["bakery.far.end", "bakery.far.middle", "bakery.near"]] * found


def places():
    """(module, name) of everything that is imported when it is asked for."""
    for path in modules("bakery"):
        for node in ast.walk(tree(path)):
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and LATER.fullmatch(node.value):
                yield node.value.split(":")


def test_places_hold_what_is_asked_for():
    found = list(places())
    assert ["bakery.stages.beam.stage", "STAGE"] in found and ["bakery.stages.beam.pictures", "pictures"] in found
    for module, name in found:
        file = ROOT / Path(*module.split("."))
        body = tree(file / "__init__.py" if file.is_dir() else file.with_suffix(".py")).body
        held = {node.name for node in body if isinstance(node, (ast.FunctionDef, ast.ClassDef))}
        held |= {getattr(target, "id", "") for node in body if isinstance(node, ast.Assign) for target in node.targets}
        assert name in held, f"{module} has no {name}"


@pytest.mark.parametrize("place", [
    "asset", "plan", "recipe", "report", "run", "scenes", "trade",
    "cli/diff.py", "cli/inspect.py", "cli/offers.py", "cli/options.py", "cli/plot.py", "cli/query.py", "cli/report.py",
    "cli/schema.py", "cli/trade.py", "cli/verify.py"])
def test_no_command_lists_stages(place):
    """Only the common currency of all renderers may be asked for by name."""
    from bakery.stages import all_stages

    names = {stage.name for stage in all_stages()} - {"medium"}
    path = ROOT / "bakery" / place
    for file in modules(f"bakery/{place}") if path.is_dir() else [path]:
        for node in ast.walk(tree(file)):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                assert node.value.partition("/")[0] not in names, f"{file}:{node.lineno}: {node.value!r}"


@pytest.mark.parametrize("folder", sorted(MAY))
def test_imports_point_down(folder):
    paths = modules(f"bakery/{folder}")
    assert paths
    for path in paths:
        for name in imports(path):
            if name.startswith("bakery."):
                assert below(name.removeprefix("bakery."), MAY[folder] | {folder, "errors"}), f"{path} imports {name}"
            elif name.startswith("renderers"):
                assert below(name, WITH_RENDERERS.get(folder, ())), f"{path} imports {name}"


def test_physics_knows_arrays_only():
    for path in modules("bakery/physics"):
        for name in imports(path):
            known = OUTSIDE | ENGINE.get(str(path.relative_to(ROOT)), set())
            assert name.startswith("bakery.") or name.split(".")[0] in known, f"{path} imports {name}"


def test_private_names_stay_in_their_package():
    wrong = []
    for path in modules("bakery"):
        package = ".".join(path.relative_to(ROOT).parent.parts)
        for node in ast.walk(tree(path)):
            if isinstance(node, ast.ImportFrom) and node.module.startswith("bakery"):
                for alias in node.names:
                    outside, private, _ = f"{node.module}.{alias.name}".partition("._")
                    if private and outside != package and alias.name != "__version__":
                        wrong.append(f"{path.relative_to(ROOT)}:{node.lineno} {alias.name}")
    assert wrong == []


def test_the_door_for_renderers_is_names_of_physics_as_they_are():
    """All but `amplitudes`, which `mie` and `goa` offer both, with the same arguments."""
    from bakery import kernels

    imported = [node for node in tree(ROOT / "bakery/kernels.py").body if isinstance(node, ast.ImportFrom)]
    names = [alias for node in imported for alias in node.names]
    assert {alias.asname for alias in names} == {None, "mie_amplitudes", "goa_amplitudes"}
    assert sorted(alias.asname or alias.name for alias in names) == sorted(kernels.__all__)


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
            if name.startswith("bakery") and not name.startswith(BAKES.get(str(path.relative_to(ROOT)), ("-",))):
                assert name in exact or name.startswith(beginnings), f"{path} imports {name}"


def test_renderers_stand_on_what_they_share():
    for path in modules("renderers"):
        if path.name == "plugin.py":
            continue  # nothing imports them
        room, *rest = path.relative_to(ROOT / "renderers").with_suffix("").parts
        if room == "materials" and rest[0] in MATERIALS:
            allowed = GROUND | MATERIALS[rest[0]] | {f"materials.{rest[0]}"}
        else:
            allowed = ROOMS.get(room, GROUND | {"materials"}) | {room}
        for name in imports(path):
            if name.startswith("renderers."):
                assert below(name.removeprefix("renderers."), allowed), f"{path} imports {name}"


def test_import_and_help_load_nothing_heavy():
    code = ("import sys, bakery, bakery.cli\n"
            "from bakery.cli import status_of\n"
            "status_of(['--help'])\n"
            "heavy = {'numpy', 'numba', 'scipy', 'h5py', 'matplotlib', 'pydantic', 'rich', 'mitsuba', 'trimesh'}\n"
            "heavy &= set(sys.modules)\n"
            "assert not heavy, heavy\n")
    subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT, stdout=subprocess.DEVNULL)
