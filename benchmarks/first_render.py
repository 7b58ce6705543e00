"""What a first render or bake takes: from sources of which nothing is compiled, with empty caches, bakes included.

    python -m benchmarks.first_render                       every scene of SCENES: seconds, processor seconds, what compiled
    python -m benchmarks.first_render candle --kernels 20   of some scenes, with their 20 longest kernels
    python -m benchmarks.first_render candle --beside TREE  beside other sources, in turns
    python -m benchmarks.first_render --record              writes bakery/run/kernels.json, which `bakery/run/ahead.py` reads
    python -m benchmarks.first_render coated_soot --record  adds to it what a scene or a recipe compiles

Processes that compile ahead are killed at the end, so what they spent is what the system says of all children, less this one's.
A render of a draft ends by its time, so the samples differ; what compiles does not.
"""

import argparse
import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.sizes import SMALL, sized

ROOT = Path(__file__).resolve().parents[1]
SCENES = sized(["candle", "glass_of_milk", "night_street", "lamp_in_dust", "heap_of_sand", "snow_at_night", "winter_evening"],
               ["candle"])
RECIPES = ["coated_soot", "white_paint", "wax", "snow_field"]  # whose stages compile what no scene of SCENES needs
RECORD = ROOT / "bakery" / "run" / "kernels.json"
# kind of material -> modules whose kernels scenes of several kinds meet where they have it
OF_KINDS = {"grains": ("renderers.materials.grains.", "bakery.physics.granular.", "bakery.physics.shapes."),
            "body": ("renderers.materials.bodies.",), "particles": ("renderers.materials.particles.",),
            "medium": ("renderers.materials.medium.", "renderers.transport.")}
LEAST = 0.2  # processor seconds of a kernel with those that it calls; what takes less is not worth an entry


def fresh(tree: Path, folder: Path) -> Path:
    """A copy of sources of which nothing is compiled."""
    for name in ("bakery", "renderers", "recipes", "assets"):
        shutil.copytree(tree / name, folder / name, ignore=shutil.ignore_patterns("__pycache__", "*.h5"))
    shutil.copytree(ROOT / "benchmarks", folder / "benchmarks", ignore=shutil.ignore_patterns("__pycache__"))
    (folder / "trace").mkdir()
    (folder / "trace" / "sitecustomize.py").write_text("import benchmarks.compiled_trace\n")
    return folder


def is_scene(name: str) -> bool:
    return (ROOT / "assets" / "scenes" / f"{name}.yaml").exists()


def first(tree: Path, name: str, alone: bool = False) -> dict:
    """A first render of a scene, or first bake of a recipe: seconds, processor seconds of the command and of processes beside
    it, and what the trace says.

    alone : on a single processor, where nothing is compiled ahead
    """
    with tempfile.TemporaryDirectory(prefix="bakery-first-") as text:
        folder = fresh(tree, Path(text) / "tree")
        environment = {name: value for name, value in os.environ.items() if name not in ("NUMBA_CACHE_DIR", "DRJIT_CACHE_DIR")}
        environment |= {"HOME": text, "XDG_CACHE_HOME": f"{text}/cache", "TRACE": f"{text}/tree/trace",
                        "PYTHONPATH": f"{folder}/trace{os.pathsep}{folder}"} | ({"BAKERY_JOBS": "1"} if alone else {})
        command = [sys.executable, "-m", "bakery", "--quality", "draft", "--quiet", "--json"]
        if is_scene(name):
            command[3:3] = ["render", f"assets/scenes/{name}.yaml", "-o", f"{text}/{name}.png",
                            *sized([], ["--set", "film.width=32", "--set", "film.height=24"])]
        else:
            command[3:3] = ["bake", f"recipes/{name}.yaml", "-o", f"{text}/{name}.h5"]
        before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
        done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
        seconds, after = time.monotonic() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
        if done.returncode not in (0, 3):
            raise SystemExit(f"{name}: {done.stderr}")
        traces = [json.loads(path.read_text()) for path in (folder / "trace").glob("*.json")]
    trace = max((trace for trace in traces if {"render", "bake"} & set(trace["arguments"])), key=lambda trace: trace["processor"])
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return {"name": name, "seconds": seconds, "processor": spent, "trace": trace}


def row(run: dict) -> str:
    trace = run["trace"]
    kernels = [kernel for kernel in trace["numba"] if not kernel["waiting"]]
    waits = sum(kernel["seconds"] for kernel in trace["numba"] if kernel["waiting"])
    traced = [kernel for kernel in trace["drjit"] if kernel["new"]]
    return (f"{run['name']:<16} {run['seconds']:8.1f} {run['processor']:10.1f} {trace['processor']:9.1f} {len(kernels):8d} "
            f"{sum(kernel['own'] for kernel in kernels):9.1f} {waits:7.1f} {len(traced):7d} "
            f"{sum(kernel['seconds'] for kernel in traced):7.1f}")


def longest(run: dict, count: int) -> list[str]:
    """The kernels of the command's process that took longest by themselves."""
    spent: dict[str, list[float]] = {}
    for kernel in run["trace"]["numba"]:
        spent.setdefault(f"{kernel['group']}: {kernel['name']}", []).append(kernel["own"])
    order = sorted(spent, key=lambda name: -sum(spent[name]))[:count]
    return [f"  {sum(spent[name]):6.2f} s  {len(spent[name])} x  {name}" for name in order]


def groups(runs: list[dict], before: dict[str, list]) -> dict[str, list]:
    """Kernels of each stage, of every scene of a renderer, of those with a kind of material, and of those with the same entries.

    before : groups that are there, which say what every scene of a renderer meets; {}: what all of these scenes met
    """
    sys.path.insert(0, str(ROOT))
    from bakery.run.ahead import groups_of
    from renderers import scene

    out: dict[str, list] = {}
    of_renderer: dict[str, list[list[tuple[str, list]]]] = {}  # its group -> of each scene its kernels, and a group for each
    for run in runs:
        mine, besides = [], ""
        if is_scene(run["name"]):
            every, *_, besides = groups_of(scene.load(ROOT / "assets" / "scenes" / f"{run['name']}.yaml"))
            of_renderer.setdefault(every, []).append(mine)
        for kernel in run["trace"]["numba"]:
            entry, group = [kernel["name"], kernel["types"]], kernel["group"]
            if kernel["depth"] or kernel["waiting"] or kernel["types"] is None or kernel["all"] < LEAST:
                continue
            if group.startswith("render"):
                mine.append((besides if group == "render" else group, entry))
            elif entry not in out.setdefault(group, []):
                out[group].append(entry)
    for every, scenes in of_renderer.items():
        general = [every, *(f"{every}: {kind}" for kind in OF_KINDS)]
        if before:
            shared = [entry for name in general for entry in before.get(name, [])]
        else:
            shared = [entry for _, entry in scenes[0] if all(entry in [other for _, other in mine] for mine in scenes)]
            for entry in shared:
                kinds = [kind for kind, modules in OF_KINDS.items() if every == "render mixed" and entry[0].startswith(modules)]
                out.setdefault(": ".join([every, *kinds]), []).append(entry)
        for name, entry in (row for mine in scenes for row in mine):
            if entry not in shared and entry not in out.setdefault(name, []):
                out[name].append(entry)
    return out


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="SCENE|RECIPE", help="those of SCENES, and with --record those of RECIPES")
    parser.add_argument("--kernels", type=int, default=0, metavar="N", help="name the N longest kernels of each scene")
    parser.add_argument("--beside", type=Path, metavar="TREE", help="other sources to measure as well")
    parser.add_argument("--alone", action="store_true", help="nothing compiled ahead")
    parser.add_argument("--record", action="store_true", help="write down the kernels of stages and renderers")
    asked = parser.parse_args()
    trees = [*([asked.beside.resolve()] if asked.beside else []), ROOT]
    print("seconds by the clock, of all processes, of the command alone; its kernels and what they took; seconds by the clock\n"
          "in which it waited for a kernel that another process compiled; kernels of Dr.Jit and what they took")
    print(f"{'scene':<16} {'clock':>8} {'processor':>10} {'command':>9} {'kernels':>8} {'compiling':>9} {'waiting':>7} "
          f"{'Dr.Jit':>7} {'':>7}", flush=True)
    runs = []
    for name in asked.names or SCENES + (RECIPES if asked.record else []):
        for tree in trees:
            runs.append(first(tree, name, asked.alone or asked.record))
            of_tree = f"  {tree}" if len(trees) > 1 else ""
            print(row(runs[-1]) + of_tree, *longest(runs[-1], asked.kernels), sep="\n", flush=True)
    if asked.record and not SMALL:
        before = json.loads(RECORD.read_text()) if asked.names else {}
        recorded = groups(runs, before)
        for name, kernels in before.items():
            recorded[name] = kernels + [entry for entry in recorded.get(name, []) if entry not in kernels]
        lines = (f"{json.dumps(name)}: [\n" + ",\n".join(map(json.dumps, kernels)) + "]"
                 for name, kernels in sorted(recorded.items()))
        RECORD.write_text("{" + ",\n".join(lines) + "}\n")


if __name__ == "__main__":
    main()
