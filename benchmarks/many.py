"""Many small recipes in one call against each by itself: time, and the same hashes.

    python -m benchmarks.many            200 recipes, every tenth of them by itself too
    python -m benchmarks.many 40 1       40 recipes, all of them by themselves too

Half of the recipes are drops of water at one wavelength, half media by their coefficients.  Kernels are compiled before.  Ratios
below 1 say that one call takes less than the sum of single calls; those of wall time depend on what else the machine does.
"""

import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.sizes import sized

HERE = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(HERE))

DROPS = """\
bakery: 1
name: r{number:03}
wavelengths: [0.55]
tolerance: 5%
particles:
  host: air
  number_density: 1e8 /m^3
  components:
    - {{name: a, material: water, size: {{distribution: lognormal, radius: {radius} um, sigma: 1.2, max: 3 um}}}}
"""
MEDIUM = """\
bakery: 1
name: r{number:03}
wavelengths: rgb
medium: {{albedo: [0.9998, 0.9995, 0.998], mean_free_path: "[0.84, 0.75, 0.68] mm", phase: {{type: hg, g: {g}}}}}
"""


def written(folder: Path, count: int) -> list[Path]:
    """Recipes that all differ."""
    paths = []
    for k in range(count):
        paths.append(folder / f"r{k:03}.yaml")
        form = DROPS if k % 2 else MEDIUM
        paths[-1].write_text(form.format(number=k, radius=round(0.4 + 0.002 * k, 4), g=round(0.5 + 0.001 * k, 4)))
    return paths


def timed(recipes, folder: Path, *more: str) -> tuple[float, float]:
    """Wall and processor seconds of one call with a cache of its own."""
    folder.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as cache:
        before, started = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
        subprocess.run([sys.executable, "-m", "bakery", *map(str, recipes), "-o", f"{folder}/", "--quiet", *more], check=True,
                       stdout=subprocess.DEVNULL, env={**os.environ, "PYTHONPATH": str(HERE), "BAKERY_CACHE": cache})
        seconds, after = time.perf_counter() - started, resource.getrusage(resource.RUSAGE_CHILDREN)
    return seconds, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main(count: int = sized(200, 2), every: int = sized(10, 1)) -> None:
    from bakery.store.read import read

    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        recipes = written(folder, count)
        # one of each kind from every stretch: neighbours take alike
        chosen = [recipe for k, recipe in enumerate(recipes) if k // 2 % every == 0]
        timed(recipes[:2], folder / "warm")
        single = [0.0, 0.0]
        for recipe in chosen:
            for kind, seconds in enumerate(timed([recipe], folder / "alone", "--jobs", "2")):
                single[kind] += seconds * count / len(chosen)
        print(f"{count} recipes by themselves, from {len(chosen)} of them: {single[0]:.0f} s, {single[1]:.0f} s of processors")
        for jobs in "1", "2":
            together = timed(recipes, folder / f"jobs{jobs}", "--jobs", jobs)
            print(f"one call, --jobs {jobs}: {together[0]:.0f} s, {together[1]:.0f} s of processors; ratios "
                  f"{together[0] / single[0]:.3f}, {together[1] / single[1]:.3f}")
            for recipe in chosen:
                alone, one = (read(folder / where / f"{recipe.stem}.h5").attributes["content_hash"]
                              for where in ("alone", f"jobs{jobs}"))
                assert alone == one, recipe
        print("hashes: equal")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
