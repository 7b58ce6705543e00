"""Kernels that are compiled ahead, by other processes, while this process is at something else.

A process compiles one kernel at a time, when it meets it.  What a stage or a renderer is going to meet is known before:
`kernels.json` has the kernels of each, with the types of their arguments, as first renders of shipped scenes met them
(`python -m benchmarks.first_render --record` writes it).  So `expect` starts processes that compile these, all
processors together with this process, and three at most.  They begin with what is met last, and this process with what is met
first; none compiles what another is at (`bakery.system.turns`), and what they compile is found on disk.  What is met now, all of
it, they take before anything else.  They end with this process, or when there is no more to do.

Nothing depends on it: a kernel that is not on the list, or is no more what the list says, is compiled where it is met.
"""

import atexit
import contextlib
import json
import os
import subprocess
import sys
import threading
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path

import bakery
from bakery.system import resources, sources

RECORD = Path(__file__).with_name("kernels.json")
MOST = 3  # processes: each takes 0.4 GB
SERIES = ("mie.coefficients", "mie.angular")  # modules of what rays are measured by: coated spheres are not
IDLE = 20.0  # seconds without a kernel to compile after which a process ends


@cache
def recorded() -> dict[str, list]:
    """Of each group (`stage packing`, `render granular`) its kernels in the order in which they are met: name and types of
    arguments, see `bakery.system.signatures`."""
    return json.loads(RECORD.read_text()) if RECORD.exists() else {}


def of(group: str, modules: Iterable[str] | None = None) -> list:
    """Kernels of a group; of some modules of `bakery.physics` (`mie.angular`) alone, where a stage says which it runs."""
    kernels = recorded().get(group, [])
    if modules is None:
        return kernels
    names = {f"bakery.physics.{module}" for module in modules}
    return [[name, arguments] for name, arguments in kernels if name.split(":")[0] in names]


def of_scene(scene) -> list:
    """Kernels that a `renderers.scene.Scene` meets, as far as its entries tell."""
    return [kernel for group in groups_of(scene) for kernel in of(group)]


def groups_of(scene) -> list[str]:
    """Names of groups: of a scene's renderer (`render mixed`), of each kind of its materials in which light is followed (`render
    mixed: grains`), and of scenes with such entries (`render mixed: body auto, grains auto`)."""
    every = f"render {scene.section}"
    entries = sorted((entry.kind, entry.method) for entry in scene.materials if hasattr(entry, "kind"))
    return [every, *(f"{every}: {kind}" for kind in scene.followed), f"{every}: {', '.join(map(' '.join, entries))}"]


def expect(kernels: Iterable, now: bool = False) -> None:
    """Kernels that this process is going to meet, in this order, and before those of earlier calls.

    now : it is about to meet them, and can do nothing else
    """
    _SHARED.expect([kernel for kernel in kernels if not _kept(kernel[0])], now)


class Measuring:
    """What stages remember by, for a plan: where it does not hold how good rays are, kernels of rays and series come next."""

    def __init__(self, memory):
        self._memory = memory

    def get(self, name: str, key: str):
        entry = self._memory.get(name, key)
        if entry is None:
            expect(of("plan") + of("stage optics", SERIES), now=True)
        return entry

    def put(self, *arguments) -> None:
        self._memory.put(*arguments)


def _kept(name: str) -> bool:
    module, function = name.split(":")
    file = Path(bakery.__file__).parents[1].joinpath(*module.split(".")).with_suffix(".py")
    return not file.exists() or sources.kept(file, function)


class _Ahead:
    """The processes of this one, which start with the first kernel that is missing."""

    def __init__(self):
        self._processes: list[subprocess.Popen] = []

    def expect(self, kernels: list, now: bool = False) -> None:
        count = min(resources.jobs() - 1, resources.processors() - 1, MOST) if kernels else 0
        if count > 0 and not self._processes:
            atexit.register(self.end)
        for process in [process for process in self._processes if process.poll() is not None]:
            self._processes.remove(process)
            _ended(process)
        # where the machine gives no process, kernels are compiled where they are met
        with contextlib.suppress(OSError):
            while len(self._processes) < count:
                self._processes.append(_process())
        for process in self._processes if kernels else ():
            # a process that has ended is missed by nobody
            with contextlib.suppress(OSError, ValueError):
                process.stdin.write(json.dumps([kernels, now]).encode() + b"\n")
                process.stdin.flush()

    def end(self) -> None:
        """Ends them, whatever they are at: what is half compiled is not kept."""
        while self._processes:
            _ended(self._processes.pop())


def _ended(process: subprocess.Popen) -> None:
    process.kill()
    process.wait()
    with contextlib.suppress(OSError):  # what it has not read is of no use any more
        process.stdin.close()


_SHARED = _Ahead()


def _process() -> subprocess.Popen:
    return subprocess.Popen([sys.executable, "-m", "bakery.run.ahead"], stdin=subprocess.PIPE, stdout=subprocess.DEVNULL,
                            stderr=subprocess.DEVNULL)


# ---- in these processes


class Waiting:
    """Kernels to compile, those that are met last first."""

    def __init__(self):
        self._kernels: list = []  # the last of them is taken next
        self._more = threading.Condition()

    def add(self, kernels: list, now: bool = False) -> None:
        """Those that are met before all others; `now`: these are taken next."""
        with self._more:
            at = len(self._kernels) if now else 0
            self._kernels[at:at] = kernels
            self._more.notify()

    def take(self, patience: float = IDLE):
        """The next, or None where there is none for so many seconds."""
        with self._more:
            self._more.wait_for(lambda: self._kernels, patience)
            return self._kernels.pop() if self._kernels else None


def compile_one(name: str, arguments: list, is_taken: Callable[[str], bool]) -> bool:
    """Compiles a kernel for arguments of some types and keeps it; whether it did, and it was not there or taken by another."""
    from bakery.system import signatures

    kernel = signatures.by_name(name)
    types = tuple(signatures.read(form) for form in arguments)
    if kernel.is_kept(types) or is_taken(kernel.turn):
        return False
    kernel.compile(types)
    return True


def _main() -> None:
    from bakery.system import turns

    waiting = Waiting()

    def listen():
        for line in sys.stdin.buffer:
            waiting.add(*json.loads(line))
        os._exit(0)  # the process that asked is over

    threading.Thread(target=listen, daemon=True).start()
    while (kernel := waiting.take()) is not None:
        # an entry that is out of date: the process that meets the kernel compiles it
        with contextlib.suppress(Exception):
            compile_one(*kernel, turns.taken)
    os._exit(0)


if __name__ == "__main__":
    _main()
