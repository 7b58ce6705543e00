"""What is broken in an asset: container, HDF5 structure, hashes, contract, physics.  The logic of `bake verify`.

The container's digest is checked in this process.  Everything that parses HDF5 happens in a child process with a time limit and a
memory limit, so that a crash or an endless loop of the library, too, is only an answer: damaged.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

from bakery.errors import AssetError, StoreError

TIME_LIMIT = 120.0  # s; a 20 MB asset takes about one, most of it to import the stages' physics
MEMORY = 4 << 30  # bytes of address space for a file whose digest is wrong, on top of 8 times its size


def verify(path: str | os.PathLike, *, time_limit: float = TIME_LIMIT, locate: bool = True) -> list[str]:
    """What is broken in an asset, one sentence each that begins with the dataset or `container`; empty for a sound one.

    path : of the asset file
    time_limit : s, for everything that parses HDF5
    locate : for a file whose digest is wrong, also find the datasets that are hit

    Raises StoreError : the system would not read the file
    """
    from bakery.store.container import Damaged, check_container
    from bakery.store.read import read_bytes

    path = os.fspath(path)
    try:
        data = read_bytes(path)
        check_container(path, data)
    except Damaged as error:
        hit = _in_child(path, "locate", time_limit, MEMORY + 8 * len(data)) if locate else []
        return [_plain(path, error), *hit]
    except AssetError as error:
        return [_plain(path, error)]
    return _in_child(path, "all", time_limit, None)


def _in_child(path: str, task: str, time_limit: float, memory: int | None) -> list[str]:
    """`_child` in a process of its own."""
    package = str(Path(__file__).resolve().parents[2])
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join([package, *filter(None, [os.environ.get("PYTHONPATH")])]),
        "HDF5_PLUGIN_PRELOAD": "::",  # no filter plugin is ever loaded
    }
    call = [sys.executable, "-c", "from bakery.asset.verify import _child; _child()", task, os.path.abspath(path),
            str(memory or 0)]
    try:
        done = subprocess.run(call, env=environment, stdin=subprocess.DEVNULL, capture_output=True, timeout=time_limit,
                              check=False)
    except subprocess.TimeoutExpired:
        return [f"container: damaged: reading it did not end within {time_limit:g} s"]
    except OSError as error:
        raise StoreError(f"{path}: cannot be verified: no child process ({error.strerror})") from error
    if done.returncode < 0:
        return [f"container: damaged: the process that read it was ended by signal {-done.returncode}"]
    try:
        return [str(sentence) for sentence in json.loads(done.stdout)]
    except ValueError:
        last = done.stderr.decode(errors="replace").strip().splitlines()[-1:] or ["no message"]
        return [f"container: could not be verified: the process that read it ended with status {done.returncode} ({last[0]})"]


def _child() -> None:
    task, path, memory = sys.argv[1:4]
    if int(memory):
        try:
            import resource

            resource.setrlimit(resource.RLIMIT_AS, (int(memory), int(memory)))
        except (ImportError, ValueError, OSError):
            pass  # the time limit still holds
    try:
        broken = _hit(path) if task == "locate" else _broken(path)
    except AssetError as error:
        broken = [_plain(path, error)]
    except StoreError as error:  # of a member: the file itself was read before
        broken = [str(error)]
    except MemoryError:
        broken = ["container: damaged: reading it takes more memory than a sound asset of its size would"]
    sys.stdout.write(json.dumps(broken))


def _broken(path: str) -> list[str]:
    """Everything that is wrong with a file whose container is sound."""
    from bakery.family.members import broken
    from bakery.family.tree import is_family
    from bakery.store.hashes import broken_hashes
    from bakery.store.read import check_format, decode, read_bytes

    data = read_bytes(path)
    faults = []
    root = decode(path, data, on_fault=lambda where, sentence: faults.append(f"{where}: {sentence}"))
    if faults:
        return faults
    try:
        check_format(path, root)
    except AssetError as error:
        faults.append(_plain(path, error))
    faults += _checksums(data, root) + broken_hashes(root)
    faults += contract(root)
    return faults or physics(root) + (broken(Path(path), root) if is_family(root) else [])


def _hit(path: str) -> list[str]:
    """Which members are corrupted, in a file whose digest is wrong."""
    from bakery.store.hashes import broken_hashes
    from bakery.store.read import decode, read_bytes

    data = read_bytes(path)
    faults = []
    root = decode(path, data, on_fault=lambda where, sentence: faults.append(f"{where}: {sentence}"))
    return faults + _checksums(data, root) or broken_hashes(root)


def _checksums(data: bytes, root) -> list[str]:
    """Datasets of a decoded tree that HDF5's own reading refuses: a second opinion on the unpacking, and with fletcher32.

    Only what the walk has let pass is touched, so that no link and no storage leads out of the file.
    """
    import io

    import h5py

    from bakery.store.tree import Dataset

    broken = []
    with h5py.File(io.BytesIO(data), "r") as file:
        for path, member in root.walk():
            if isinstance(member, Dataset):
                try:
                    file[path][...]
                except (OSError, KeyError, RuntimeError, ValueError, TypeError):
                    broken.append(f"{path}: its bytes do not match their checksum")
    return broken


def contract(root) -> list[str]:
    """Where a tree departs from `docs/asset-format.md` and from what its stages declare, physics apart."""
    from bakery.family.tree import departures, is_family
    from bakery.stages.conform import faults

    return faults(root) + (departures(root) if is_family(root) else [])


def physics(root) -> list[str]:
    """What the stages' own checks say of their groups: `verify` lists it, `inspect` and the page show it."""
    import numpy as np

    from bakery.family.tree import is_family
    from bakery.family.tree import physics as of_family
    from bakery.stages.conform import stages_of

    broken = of_family(root) if is_family(root) else []
    for stage in stages_of(root):
        try:
            with np.errstate(all="ignore"):  # a sum of zero, and the like: the rules say so in words
                broken += [f"{stage.name}: {rule}" for rule in stage.check(root.members[stage.name])]
        except Exception as error:  # a check trips over a group that lacks what it needs: the contract says what
            broken.append(f"{stage.name}: its rules cannot be checked ({type(error).__name__}: {error})")
    return broken


def _plain(path: str, error: Exception) -> str:
    """An AssetError's text without the path, for it is known; `container` where it names no place."""
    text = str(error).removeprefix(f"{path}: ").removeprefix("damaged: ")
    return text if text.startswith(("container: ", "the root")) else f"container: {text}"
