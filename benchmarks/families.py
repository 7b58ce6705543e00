"""A family of spectra: python -m benchmarks.families [RECIPE.yaml ...]

Sulphate in humid air, 500 wavelengths by 50 relative humidities, baked by `bake` as a user would into an empty cache: seconds of
a core and of the clock, largest memory of the process, and bytes of the family's file and of its members.  Recipes that are
named are baked instead.
"""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from bakery.system import resources
from benchmarks.sizes import sized

WAVELENGTHS, HUMIDITIES = sized(500, 10), sized(50, 3)
HUMID = f"""\
bakery: 1
name: humid
measure: integrated
wavelengths: {{from: 0.3, to: 1.1, count: {WAVELENGTHS}}}
particles:
  relative_humidity: 80%
  components:
    - name: sulphate
      material: {{n: 1.53, k: 1e-7}}
      mass_concentration: 10 ug/m^3
      density: 1.77 g/cm^3
      size: {{distribution: lognormal, radius: 70 nm, sigma: 1.8, max: 2 um}}
      growth: {{kappa: 0.61}}
sweep:
  particles.relative_humidity: {{from: 0%, to: 95%, count: {HUMIDITIES}}}
  refine: false
"""


def measured(recipe: Path, folder: Path) -> str:
    """One bake in words."""
    target, started = folder / "family.h5", time.monotonic()
    bake = subprocess.Popen([sys.executable, "-m", "bakery", str(recipe), "-o", str(target)], stdout=subprocess.DEVNULL,
                            stderr=subprocess.DEVNULL, env={**os.environ, "BAKERY_CACHE": str(folder / "cache")})
    _, status, used = os.wait4(bake.pid, 0)
    wall = time.monotonic() - started
    if status:
        raise SystemExit(f"{recipe}: the bake ended with status {os.waitstatus_to_exitcode(status)}")
    members = [file.stat().st_size for file in target.with_suffix("").glob("*.h5")]
    return (f"{recipe.stem}: {len(members)} points, {used.ru_utime + used.ru_stime:.3g} s of a core, {wall:.3g} s of the clock, "
            f"{resources.in_words(1024 * used.ru_maxrss)} of memory; file {resources.in_words(target.stat().st_size)}, members "
            f"{resources.in_words(sum(members))}")


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        recipes = [Path(name) for name in sys.argv[1:]]
        if not recipes:
            recipes = [Path(folder) / "humid.yaml"]
            recipes[0].write_text(HUMID)
        for i, recipe in enumerate(recipes):
            own = Path(folder) / str(i)
            own.mkdir()
            print(measured(recipe, own), flush=True)


if __name__ == "__main__":
    main()
