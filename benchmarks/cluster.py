"""What a cluster costs and gains: overhead of messages, speed-up by the number of workers, workers that are killed.

    python -m benchmarks.cluster overhead            time of blocks of a second and of 0.1 s on 8 workers over their own
    python -m benchmarks.cluster speed [RECIPE[:TOLERANCE] …]   simulated speed-up on 1 to 1024 workers from measured blocks
    python -m benchmarks.cluster killed              4 workers, one of which is killed every 20 s, against undisturbed ones

`speed` bakes each recipe on one thread, times every block, and plays the messages of `bakery.run.messages` with the overhead that
`overhead` measures.  Blocks of `overhead` sleep, so what else the machine does matters little.
"""

import heapq
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from concurrent.futures import Executor
from contextlib import contextmanager
from pathlib import Path

from benchmarks.sizes import sized

HERE = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(HERE))

LOCAL = sized(8, 2)  # workers of `overhead`
WAY = 0.007  # seconds from a message to its values besides its blocks: `overhead`
WORKERS = [2**k for k in range(sized(11, 2))]
RECIPES = sized(["fog", "fog:0.3%", "snow_storm", "cirrus"], ["haze"])


@contextmanager
def local(workers: int):
    """A cluster on this machine."""
    import logging

    from distributed import LocalCluster

    os.environ["PYTHONPATH"] = str(HERE)
    with LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=None, silence_logs=logging.CRITICAL) as found:
        yield found


def overhead() -> None:
    """Prints what messages cost."""
    from bakery.run import dask, messages

    with local(LOCAL) as found, dask.cluster(found.scheduler_address) as workers:
        workers.map(time.sleep, [0.1] * 16)
        for seconds, count in sized(((1.0, 80), (0.1, 400)), ((0.1, 16),)):
            workers._pace.clear()
            started = time.perf_counter()
            workers.map(time.sleep, [seconds] * count)
            taken = time.perf_counter() - started
            over = 100 * (taken / (seconds * count / LOCAL) - 1)
            print(f"{count} blocks of {seconds} s on {LOCAL} workers: {over:.1f} % over their own time")
        dask.HERE, messages.AIM, messages.SPARE = 0.0, 0.0, 0.0  # a block a message
        for count in 1, sized(1000, 10):
            times = []
            for _ in range(sized(30, 2) if count == 1 else 1):
                started = time.perf_counter()
                workers.map(time.sleep, [0.0] * count)
                times.append((time.perf_counter() - started) / count)
            print(f"{count} message{'s' * (count > 1)} of nothing: {1000 * sorted(times)[len(times) // 2]:.1f} ms each")


class Recorder(Executor):
    """Runs blocks here, one by one, and remembers what they took of the processor."""

    def __init__(self):
        self.maps: list[tuple[str, list[float]]] = []

    def map(self, function, *columns):
        values, seconds = [], []
        for task in zip(*columns, strict=True):
            started = time.process_time()
            values.append(function(*task))
            seconds.append(time.process_time() - started)
        self.maps.append((getattr(function, "__name__", ""), seconds))
        return values


def recorded(recipe: str) -> tuple[float, list[tuple[str, list[float]]]]:
    """Processor seconds of a bake besides its blocks, and of the blocks of each map; kernels are loaded before."""
    from bakery.plan.asked import Asked
    from bakery.run.bake import executed, planned
    from bakery.run.cache import Cache

    name, _, tolerance = recipe.partition(":")
    with tempfile.TemporaryDirectory() as folder:
        for settings in {"tolerance": "30%"}, {"tolerance": tolerance} if tolerance else {}:
            cache = Cache(Path(folder, "cache"))
            plan = planned(HERE / "recipes" / f"{name}.yaml", f"{folder}/", asked=Asked(settings), cache=cache, force=True)
            recorder, started = Recorder(), time.process_time()
            executed(plan, cache=cache, executor=recorder)
            taken = time.process_time() - started
    return taken - sum(sum(seconds) for _, seconds in recorder.maps), recorder.maps


def simulated(serial: float, maps, workers: int) -> float:
    """Seconds of a bake on so many workers."""
    from bakery.run.dask import HERE as LITTLE

    taken, pace = serial, {}
    for name, seconds in maps:
        if len(seconds) * pace.get(name, 1.0) < LITTLE:
            taken += sum(seconds)
        else:
            taken += _messages(seconds, workers, pace.get(name))
        pace[name] = 0.5 * (pace.get(name, sum(seconds) / len(seconds)) + sum(seconds) / len(seconds))
    return taken


def _messages(seconds: list[float], workers: int, pace: float | None) -> float:
    """Seconds of one map; messages as `Map` makes them, each to the worker that is free first."""
    from bakery.run.messages import AHEAD, COST, together

    clock, next_, done = 0.0, 0, []  # of this process; block; times at which values are back
    free = [0.0] * workers
    while next_ < len(seconds):
        if len(done) >= AHEAD * workers:
            clock = max(clock, heapq.heappop(done))
        count = together(pace, len(seconds) - next_, workers)
        clock += COST
        end = max(clock + WAY / 2, heapq.heappop(free)) + sum(seconds[next_:next_ + count])
        heapq.heappush(free, end)
        heapq.heappush(done, end + WAY / 2)
        next_ += count
        pace = pace or seconds[0]
    return max(clock, *done)


def speed(*recipes: str) -> None:
    """Prints a table: speed-up against one thread without a cluster."""
    rows = []
    for recipe in recipes or RECIPES:
        serial, maps = recorded(recipe)
        blocks = [one for _, seconds in maps for one in seconds]
        whole = serial + sum(blocks)
        longest = f"{1000 * max(blocks, default=0.0):.0f} ms"
        rows.append([recipe, f"{whole:.3g} s", f"{100 * serial / whole:.0f} %", str(len(blocks)), longest,
                     *(f"{whole / simulated(serial, maps, workers):.1f}" for workers in WORKERS)])
    print("| recipe | one thread | besides blocks | blocks | longest | " + " | ".join(map(str, WORKERS)) + " |")
    print("|" + "---|" * (5 + len(WORKERS)))
    for row in rows:
        print("| " + " | ".join(row) + " |")


BETWEEN = sized(20.0, 3.0)  # s, of kills
DROPS = """\
bakery: 1
name: s{k}
wavelengths: rgb
tolerance: 0.7%
particles:
  host: air
  number_density: 1e8 /m^3
  components:
    - {{name: a, material: water, size: {{distribution: lognormal, radius: {radius} um, sigma: 1.3, max: 100 um}}}}
"""


def killed(count: str = sized("8", "2")) -> None:
    """Prints the time of recipes on 4 workers of which one is killed every 20 s, over that without."""
    from bakery.store.read import read

    with tempfile.TemporaryDirectory() as folder, local(4) as found:
        recipes = [Path(folder, f"s{k}.yaml") for k in range(int(count))]
        for k, recipe in enumerate(recipes):
            recipe.write_text(DROPS.format(k=k, radius=sized(15, 1) + k))
        times, hashes = [], []
        _bake(recipes[:1], folder, found)  # workers load their kernels
        for deadly in False, True:
            stop, kills = threading.Event(), []
            killer = threading.Thread(target=_kill, args=(found, stop, kills))
            if deadly:
                killer.start()
            times.append(_bake(recipes, folder, found))
            stop.set()
            if deadly:
                killer.join()
            hashes.append([read(Path(folder, f"s{k}.h5")).attributes["content_hash"] for k in range(len(recipes))])
            print(f"{times[-1]:.0f} s, {len(kills)} workers killed")
    print(f"ratio {times[1] / times[0]:.2f}; hashes {'equal' if hashes[0] == hashes[1] else 'DIFFER'}")


def _bake(recipes, folder, found) -> float:
    started = time.perf_counter()
    with tempfile.TemporaryDirectory() as cache:
        subprocess.run([sys.executable, "-m", "bakery", *map(str, recipes), "-o", f"{folder}/", "--force", "--cluster",
                        found.scheduler_address], check=True, stdout=subprocess.DEVNULL,
                       env={**os.environ, "PYTHONPATH": str(HERE), "BAKERY_CACHE": cache})
    return time.perf_counter() - started


def _kill(found, stop: threading.Event, kills: list) -> None:
    while not stop.wait(BETWEEN):
        worker = list(found.workers.values())[len(kills) % 4]
        if worker.pid:
            os.kill(worker.pid, signal.SIGKILL)
            kills.append(worker.pid)


if __name__ == "__main__":
    if len(sys.argv) < 2 or sys.argv[1] not in ("overhead", "speed", "killed"):
        sys.exit(__doc__)
    {"overhead": overhead, "speed": speed, "killed": killed}[sys.argv[1]](*sys.argv[2:])
