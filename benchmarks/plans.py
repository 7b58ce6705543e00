"""Plans against bakes: time, memory and file of every shipped recipe and of twelve others.

    python -m benchmarks.plans                  all of them
    python -m benchmarks.plans fog narrow       only these
    python -m benchmarks.plans --compiling      seconds to compile the kernels of each module (bakery/run/compiling.py)

Each figure is predicted over measured: 1 is right, 2 is twice too much.  `empty` are plans of a bakery that has baked nothing
before, `used` of one that has baked all the other recipes here, but not this one.  Each bake is a process of its own with one
worker, and its time is that of the processor, so that a busy machine does not matter much; compiling is not in it.  Of a family,
whose time is that of its whole bake, the plan has what its pilot says.
"""

import json
import math
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from types import SimpleNamespace

from benchmarks.sizes import sized

HERE = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(HERE))

_DROPS = "particles: {{host: {host}, number_density: 1e8 /m^3, components: [{{name: a, material: {material}, size: {size}}}]}}\n"


def _drops(size, material="water", host="air", more="", wavelengths="rgb", tolerance="1%"):
    return f"wavelengths: {wavelengths}\ntolerance: {tolerance}\n{more}" + _DROPS.format(size=size, material=material, host=host)


def _grains(shape, surface, packing, more=""):
    return ("wavelengths: rgb\ntolerance: 2%\n" + more + "grains:\n  radius: 0.3 mm\n  components:\n"
            f"    - {{name: a, shape: {shape}, surface: {surface}}}\npacking: {packing}\n")


OTHERS = {
    "narrow": _drops("{distribution: lognormal, radius: 5 um, sigma: 1.1}", wavelengths="[0.55]"),
    "large": _drops("{distribution: gamma, radius: 20 um, variance: 0.1}", tolerance="3%"),
    "polarised": _drops("{distribution: lognormal, radius: 2 um, sigma: 1.6, max: 30 um}", more="phase: {polarized: true}\n"),
    "whole": _drops("{distribution: gamma, radius: 30 um, variance: 0.1, max: 150 um}", "ice", more="measure: integrated\n"),
    "fine": _drops("{distribution: lognormal, radius: 1 um, sigma: 1.5}", tolerance="0.3%"),
    "smoke": _drops("{distribution: lognormal, radius: 0.2 um, sigma: 1.8, max: 3 um}", "soot", wavelengths="visible8"),
    "loose": "tolerance: 1%\npacking: {fraction: 0.4, count: 3000}\n",
    "sizes": "tolerance: 3%\npacking: {fraction: [0.3, 0.58], count: 800, radii: {distribution: lognormal, sigma: 1.2}}\n",
    "cubes": _grains("{type: crystal, seed: 1, habit: cube}", "{type: dielectric, material: nacl, roughness: 0.1}",
                     "{fraction: 0.5, count: 200}", "scatterometer: {tolerance: 2%, triangles: 5000}\n"),
    "pebbles": _grains("{type: rock, seed: 2}", "{type: diffuse, reflectance: 0.5}", "{fraction: 0.55, count: 300}",
                       "scatterometer: {tolerance: 1%}\n"),
    "gel": "wavelengths: [0.55]\ntolerance: 3%\nmedium: {albedo: 0.9, mean_free_path: 1 mm, phase: {type: hg, g: 0.5}}\n"
           "multiple_scattering: {sources: [point, segment], tolerance: 3%}\n",
    "beam": "wavelengths: rgb\ntolerance: 3%\n"
            "medium: {albedo: [0.99, 0.97, 0.9], mean_free_path: 1 m, phase: {type: hg, g: 0.85}}\nbeam: {}\n",
}
_COARSE = "scatterometer: {tolerance: 10%, triangles: 300}\neffective_medium: {walks: 10000}\n"
_GEL = "tolerance: 10%\nwavelengths: [0.55]\nmedium: {albedo: 0.9, mean_free_path: 1 mm, phase: {type: isotropic}}\n"
# all kernels, little work
COMPILED = {
    "rays": _drops("{distribution: gamma, radius: 0.2 mm, variance: 0.1}", tolerance="10%", wavelengths="[0.55]",
                   more="measure: integrated\nphase: {method: goa}\n"),
    "tile": "tolerance: 10%\npacking: {fraction: 0.3, count: 100}\n",
    "ball": _grains("{type: sphere}", "{type: dielectric, material: ice}", "{fraction: 0.3, count: 100}", _COARSE),
    "dull": _grains("{type: sphere}", "{type: dielectric, material: ice, roughness: 0.1}", "{fraction: 0.3, count: 100}",
                    _COARSE),
    "cube": _grains("{type: crystal, seed: 1, habit: cube}", "{type: dielectric, material: ice}", "{fraction: 0.3, count: 100}",
                    _COARSE),
    "flake": _grains("{type: aggregate, seed: 1, arrangement: star, bodies: 3}", "{type: diffuse, reflectance: 0.5}",
                     "{fraction: 0.3, count: 100}", _COARSE),
    "solid": _GEL + "multiple_scattering: {sources: [point, segment], tolerance: 10%}\n",
    "counted": _GEL + "multiple_scattering: {sources: [point], tolerance: 10%, method: photons, photons: 10000}\n",
    "spread": _GEL + "beam: {photons: 20000}\n",
    "layer": _GEL + "surface: {thickness: 1 mm, boundary: {index: 1.5}}\n",
    "snow": _grains("{type: sphere}", "{type: dielectric, material: ice}", "{fraction: 0.5, count: 200}",
                    _COARSE + "surface: {tolerance: 30%}\n"),
    "shells": "tolerance: 10%\nwavelengths: [0.55]\nparticles: {host: air, number_density: 1e8 /m^3, components: [{name: a, "
              "material: soot, size: {distribution: lognormal, radius: 50 nm, sigma: 1.6, max: 1 um}, "
              "coating: {material: {n: 1.53, k: 1e-7}, ratio: 2}}]}\n",
}


def one(recipe: str, folder: str) -> None:
    """Bake in this process with an empty cache in `folder`; prints what was predicted and what it took (JSON)."""
    from numba.core import event

    from bakery import run
    from bakery.run import standing
    from bakery.run.bake import executed, planned
    from bakery.run.cache import Cache
    from bakery.run.family_pilot import foretold
    from bakery.run.progress import Progress
    from bakery.system import resources

    # the processor's clock: other work on the machine does not count
    run.time = run.compiling.time = SimpleNamespace(monotonic=time.process_time)
    modules, stack = {}, []

    class Modules(event.Listener):
        """Seconds of compiling by module, what the module's kernels call in others apart."""

        def on_start(self, happened):
            stack.append((happened.data["dispatcher"].py_func.__module__, time.process_time(), [0.0]))

        def on_end(self, _):
            module, began, within = stack.pop()
            spent = time.process_time() - began
            own = module.startswith("bakery.")
            if stack:
                stack[-1][2][0] += spent if own else within[0]  # what numba brings along belongs to who calls it
            if own or not stack:
                modules[module] = modules.get(module, 0.0) + spent - within[0]

    class Told(Progress):
        def __init__(self):
            self.traces = {}

        def stage(self, name, title, tolerance, seconds):
            self.trace = self.traces[name] = [(time.process_time(), 0.0)]

        def update(self, fraction, error=None, state=""):
            self.trace.append((time.process_time(), fraction))

        def done(self, name, text):
            self.trace.append((time.process_time(), 1.0))

    cache, told = Cache(Path(folder)), Told()
    with event.install_listener("numba:compile", Modules()):
        plan = foretold(planned(recipe, Path(folder) / "a.h5", cache=cache, jobs=1), Progress())
        began = time.process_time()
        baked = executed(plan, cache=cache, jobs=1, progress=told)
        took = time.process_time() - began - sum(modules.values())
    if plan.recipe.sweep is not None:
        files = [baked.output, *baked.output.with_suffix("").iterdir()]
        print(json.dumps({"seconds": plan.seconds, "memory": plan.memory, "file": plan.file, "peak": resources.peak_memory(),
                          "size": sum(file.stat().st_size for file in files), "took": took, "traces": told.traces}))
        return
    peak = max(standing.asset_at(baked.output)[f"provenance/{step.stage.name}"].attributes["peak_memory"] for step in plan.steps)
    print(json.dumps({
        "seconds": plan.seconds - sum(step.cost.compiling for step in plan.steps), "memory": plan.memory, "file": plan.file,
        "peak": peak, "size": baked.output.stat().st_size, "compiling": modules, "traces": told.traces,
        "stages": {step.stage.name: [step.cost.seconds, step.cost.compiling] for step in plan.steps}}))


def _baked(name: str, text: str, folder: Path) -> dict:
    """What `one` prints of a recipe, and the speeds that its cache holds afterwards."""
    recipe, kept = HERE / "recipes" / f"{name}.yaml", folder / name
    kept.mkdir(parents=True)
    if text:
        recipe = folder / f"{name}.yaml"
        recipe.write_text(f"bakery: 1\nname: {name}\n{text}")
    done = subprocess.run([sys.executable, "-m", "benchmarks.plans", "--one", str(recipe), str(kept)], cwd=HERE, text=True,
                          capture_output=True, env={"OPENBLAS_NUM_THREADS": "1", **os.environ})  # as `bake` sets it
    if done.returncode:
        raise SystemExit(f"{name}: {done.stderr}")
    speeds = kept / "speed.json"  # of work that takes no time there is none
    return json.loads(done.stdout) | {"recipe": str(recipe), "speeds": json.loads(speeds.read_text()) if speeds.exists() else {}}


def _used(found: dict, name: str, folder: Path) -> float:
    """Seconds that a plan expects where all the other recipes were baked before."""
    from bakery.run.bake import planned
    from bakery.run.cache import Cache
    from bakery.run.family_pilot import foretold
    from bakery.run.progress import Progress

    speeds: dict = {}
    for other, result in found.items():
        for kind, entries in result["speeds"].items():
            speeds.setdefault(kind, []).extend(entries if other != name else [])
    (folder / "speed.json").write_text(json.dumps(speeds))
    plan = foretold(planned(found[name]["recipe"], folder / "nothing.h5", cache=Cache(folder), jobs=1), Progress())
    return plan.seconds - sum(step.cost.compiling for step in (plan.steps if plan.recipe.sweep is None else ()))


def main(chosen) -> None:
    shipped = {path.stem: "" for path in sorted((HERE / "recipes").glob("*.yaml"))}
    chosen = chosen or sized((), ("haze", "milk"))
    names = {name: text for name, text in (shipped | OTHERS).items() if not chosen or name in chosen}
    found, ratios = {}, {"empty": [], "used": [], "memory": [], "file": []}
    with tempfile.TemporaryDirectory() as kept:
        for name, text in names.items():
            found[name] = _baked(name, text, Path(kept) / "first")
            if found[name].get("compiling"):  # no time is remembered of a stage that was compiling for most of it
                found[name] = _baked(name, text, Path(kept) / "again")
            print(f"{name}: {_took(found[name]):.2f} s", file=sys.stderr, flush=True)
        print(f"{'recipe':<14} {'seconds':>8} {'empty':>7} {'used':>7} {'memory':>7} {'file':>7}")
        for name, result in found.items():
            took = _took(result)
            row = {"empty": result["seconds"] / took, "used": _used(found, name, Path(kept)) / took,
                   "memory": result["memory"] / result["peak"], "file": result["file"] / result["size"]}
            print(f"{name:<14} {took:8.2f} " + " ".join(f"{value:7.2f}" for value in row.values()), flush=True)
            for key, value in row.items():
                ratios[key].append(value)
    for key, values in ratios.items():
        far = [name for name, value in zip(found, values) if not 0.5 <= value <= 2]
        mean = math.exp(sum(map(math.log, values)) / len(values))
        print(f"{key}: geometric mean {mean:.2f}, beyond a factor of 2: {', '.join(far) or 'none'}")


def _took(result: dict) -> float:
    """Seconds; of a family those of its bake, as the cache remembers only the last of many."""
    return result.get("took") or sum(seconds for entries in result["speeds"].values() for _, _, seconds in entries)


def compiling() -> None:
    """Seconds by module: work of each kind, with no compiled kernel at hand."""
    total: dict = {}
    with tempfile.TemporaryDirectory() as kept:
        os.environ["NUMBA_CACHE_DIR"] = f"{kept}/numba"
        for name, text in COMPILED.items():
            for module, seconds in _baked(name, text, Path(kept))["compiling"].items():
                total[module] = total.get(module, 0.0) + seconds
    for module, seconds in sorted(total.items()):
        print(f'    "{module.removeprefix("bakery.")}": {seconds:.2g},')


if __name__ == "__main__":
    asked = sys.argv[1:]
    if asked[:1] == ["--one"]:
        one(*asked[1:])
    elif asked[:1] == ["--compiling"]:
        compiling()
    else:
        main(asked)
