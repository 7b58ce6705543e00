"""What an entry of a shared cache costs against a bake: python -m benchmarks.shared_cache [RECIPE …]

A server of objects (moto's, `pip install ".[store]" "moto[server]"`) on this machine; each line is `bake RECIPE` as a process of
its own, one thread, kernels compiled before: without a store and with an empty cache; with an empty store; with a full store and
an empty cache in front of it; with a full cache.  Seconds by the clock, the least of three, and of the processor, with imports.
"""

import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

HERE = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(HERE))

from benchmarks.sizes import sized  # noqa: E402
from tests.robustness.objects import Server, environment  # noqa: E402

RECIPES = sized(("milk", "fog", "cirrus", "snow_storm", "bumpy_sphere"), ("haze",))
TIMES = sized(3, 1)


def bake(recipe: str, home: Path, address: str, endpoint: str) -> tuple[float, float]:
    """Seconds by the clock and of the processor."""
    used, begun = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
    command = [sys.executable, "-m", "bakery", HERE / "recipes" / f"{recipe}.yaml", "-o", home / "out.h5", "--jobs", "1"]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                   env={**os.environ, "PYTHONPATH": str(HERE), **environment(home, address, endpoint)})
    wall, now = time.monotonic() - begun, resource.getrusage(resource.RUSAGE_CHILDREN)
    (home / "out.h5").unlink()
    return wall, now.ru_utime + now.ru_stime - used.ru_utime - used.ru_stime


def least(recipe: str, folder: Path, again: bool, address: str = "", endpoint: str = "") -> str:
    """Of a machine with an empty cache, or with the cache that it has just filled (`again`)."""
    found = []
    for _ in range(TIMES):
        with tempfile.TemporaryDirectory(dir=folder) as home:
            times = bake(recipe, Path(home), address, endpoint)
            found.append(bake(recipe, Path(home), address, endpoint) if again else times)
    return "{:8.2f} ({:6.2f})".format(*map(min, zip(*found)))


def main() -> None:
    print(f"{'':14} {'bake':>17} {'and store':>17} {'fetch':>17} {'own cache':>17}   bytes fetched")
    with tempfile.TemporaryDirectory() as folder, Server() as server:
        for recipe in sys.argv[1:] or RECIPES:
            least(recipe, Path(folder), False)  # compiles
            alone = least(recipe, Path(folder), False)
            with tempfile.TemporaryDirectory(dir=folder) as home:
                wall, cpu = bake(recipe, Path(home), f"{server.address}/{recipe}", server.endpoint)
                size = sum(path.stat().st_size for path in Path(home).glob("cache/bakery/*.h5"))
            fetched = least(recipe, Path(folder), False, f"{server.address}/{recipe}", server.endpoint)
            own = least(recipe, Path(folder), True, f"{server.address}/{recipe}", server.endpoint)
            print(f"{recipe:14} {alone} {wall:8.2f} ({cpu:6.2f}) {fetched} {own} {size:10,}", flush=True)


if __name__ == "__main__":
    main()
