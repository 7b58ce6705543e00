"""What a process compiles, and for how long: written as JSON into the folder TRACE when it ends.

`sitecustomize` of a temporary folder imports this (`benchmarks/first_render.py`), so it sees every process that a command starts.
"""

import atexit
import importlib.abc
import importlib.util
import json
import os
import sys
import threading
import time

_BEGAN = time.time()
_records: list[dict] = []


def _numba(event) -> None:
    """Takes down what numba compiles: `own` without the kernels that a kernel calls."""
    local = threading.local()

    class Listener(event.Listener):
        def on_start(self, _event):
            local.__dict__.setdefault("stack", []).append([time.thread_time(), time.time(), 0.0])

        def on_end(self, event):
            processor, wall, inner = local.stack.pop()
            spent = time.thread_time() - processor
            if local.stack:
                local.stack[-1][2] += spent
            function = event.data["dispatcher"].py_func
            _records.append({
                "name": f"{function.__module__}:{function.__qualname__}", "own": spent - inner, "all": spent,
                "seconds": time.time() - wall, "at": wall - _BEGAN, "depth": len(local.stack), "group": _group(),
                "types": _types(event.data["args"])} | {key: event.data.get(key, False) for key in ("waiting", "linking")})

    event.register("numba:compile", Listener())


def _types(arguments) -> list | None:
    try:
        from bakery.system import signatures

        return [signatures.written(kind) for kind in arguments]
    except (ImportError, ValueError):  # sources of before have no form for them
        return None


def _group() -> str | None:
    """What the main thread is at, as `bakery/run/kernels.json` calls it; the function that runs a stage has it as `step`, and
    what renders passes has the scene, by the methods that were chosen, in `self`."""
    frame = sys._current_frames().get(threading.main_thread().ident)
    while frame:
        module, name = frame.f_globals.get("__name__"), frame.f_code.co_name
        if module == "bakery.run" and name == "_compute":
            return f"stage {frame.f_locals['step'].stage.name}"
        if module == "bakery.run" and name == "_priced":
            return "plan"
        rendering = frame.f_locals.get("self") if module == "renderers.pictures.passes" else None
        if isinstance(rendering, getattr(sys.modules.get(module), "Rendering", ())) and rendering.job.scene.choice is not None:
            return sys.modules["bakery.run.ahead"].groups_of(rendering.job.scene)[-1]
        frame = frame.f_back
    return "render"


def _drjit(drjit) -> None:
    drjit.set_flag(drjit.JitFlag.KernelHistory, True)


_HOOKS = {"numba.core.event": _numba, "drjit": _drjit}


class _Finder(importlib.abc.MetaPathFinder):
    """Calls a hook when its module has been imported."""

    def find_spec(self, name, path, target=None):
        if name not in _HOOKS:
            return None
        hook, spec = _HOOKS.pop(name), importlib.util.find_spec(name)
        execute = spec.loader.exec_module

        def exec_module(module):
            execute(module)
            hook(module)

        spec.loader.exec_module = exec_module
        return spec


def _kernels_of_drjit() -> list[dict]:
    if "drjit" not in sys.modules:
        return []
    history = sys.modules["drjit"].kernel_history()
    return [{"seconds": (kernel.get("codegen_time", 0.0) + kernel.get("backend_time", 0.0)) / 1e3,
             "new": not kernel.get("cache_hit", True)} for kernel in history if "JIT" in str(kernel.get("type"))]


def _write() -> None:
    used = os.times()
    text = json.dumps({"processor": used.user + used.system, "seconds": time.time() - _BEGAN, "arguments": sys.argv,
                       "numba": _records, "drjit": _kernels_of_drjit()})
    with open(os.path.join(os.environ["TRACE"], f"{os.getpid()}.json"), "w") as file:
        file.write(text)


if "TRACE" in os.environ:
    sys.meta_path.insert(0, _Finder())
    atexit.register(_write)
