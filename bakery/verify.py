"""What is broken in an asset: container, HDF5 structure, hashes, contract, physics.  The logic of `bake verify`.

The container's digest is checked in this process.  Everything that parses HDF5 happens in a child process with a time limit and a
memory limit, so that a crash or an endless loop of the library, too, is only an answer: damaged.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path

from bakery.errors import AssetError, StoreError

TIME_LIMIT = 120.0  # s; a 20 MB asset takes about one, most of it to import the stages' physics
MEMORY = 4 << 30  # bytes of address space for a file whose digest is wrong, on top of 8 times its size

STAGE_ATTRIBUTES = {"stage": str, "stage_version": int, "input_hash": str, "content_hash": str, "tolerance": float,
                    "achieved_error": float, "error_measure": str}
ROOT_ATTRIBUTES = {"format": str, "format_version": int, "name": str, "bakery_version": str, "content_hash": str}


def verify(path: str | os.PathLike, *, time_limit: float = TIME_LIMIT, locate: bool = True) -> list[str]:
    """What is broken in an asset, one sentence each that begins with the dataset or `container`; empty for a sound one.

    Parameters
    ----------
    path : of the asset file
    time_limit : s, for everything that parses HDF5
    locate : for a file whose digest is wrong, also find the datasets that are hit

    Raises
    ------
    StoreError : the system would not read the file
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
    package = str(Path(__file__).resolve().parents[1])
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join([package, *filter(None, [os.environ.get("PYTHONPATH")])]),
        "HDF5_PLUGIN_PRELOAD": "::",  # no filter plugin is ever loaded
    }
    call = [sys.executable, "-c", "from bakery.verify import _child; _child()", task, os.path.abspath(path), str(memory or 0)]
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
    except MemoryError:
        broken = ["container: damaged: reading it takes more memory than a sound asset of its size would"]
    sys.stdout.write(json.dumps(broken))


def _broken(path: str) -> list[str]:
    """Everything that is wrong with a file whose container is sound."""
    from bakery.store.hashes import broken_hashes
    from bakery.store.read import check_format, decode, read_bytes

    data = read_bytes(path)
    faults = []
    root = decode(path, data, on_fault=lambda place, sentence: faults.append(f"{place}: {sentence}"))
    if faults:
        return faults
    try:
        check_format(path, root)
    except AssetError as error:
        faults.append(_plain(path, error))
    faults += _checksums(data, root) + broken_hashes(root)
    return faults + contract(root) + (physics(root) if not faults else [])


def _hit(path: str) -> list[str]:
    """Which members a damage has reached, in a file whose digest is wrong."""
    from bakery.store.hashes import broken_hashes
    from bakery.store.read import decode, read_bytes

    data = read_bytes(path)
    faults = []
    root = decode(path, data, on_fault=lambda place, sentence: faults.append(f"{place}: {sentence}"))
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
    """Where a tree departs from `docs/asset-format.md`, physics apart."""
    return list(_contract(root))


def _contract(root) -> Iterable[str]:
    import numpy as np

    from bakery.store.tree import Dataset, Group, is_text

    yield from _attributes("root", root.attributes, ROOT_ATTRIBUTES)
    recipe, wavelength = root.members.get("recipe"), root.members.get("wavelength")
    if recipe is None or not is_text(recipe):
        yield "recipe: missing, or not UTF-8 text in a dataset of bytes"
    if not isinstance(wavelength, Dataset) or wavelength.data.ndim != 1 or not wavelength.data.size or wavelength.units != "um":
        yield "wavelength: missing, or not an array (L,) in um"
    elif not (wavelength.data > 0).all() or not np.isfinite(wavelength.data).all():
        yield "wavelength: not positive and finite"
    if not isinstance(root.members.get("provenance"), Group):
        yield "provenance: missing"
    stages = {stage.name: stage for stage in _stages(root)}
    for name, member in root.members.items():
        if isinstance(member, Group) and name != "provenance":
            yield from _attributes(name, member.attributes, STAGE_ATTRIBUTES)
            if member.attributes.get("stage") != name:
                yield f"{name}: its attribute `stage` is {member.attributes.get('stage')!r}"
            if name in stages:
                yield from _outputs(name, member, stages[name])
        elif name not in ("recipe", "wavelength", "provenance"):
            yield f"{name}: does not belong into the root of an asset"
    for path, member in root.walk():
        if isinstance(member, Dataset):
            yield from _dataset(path, member, root)


def _attributes(place: str, attributes, wanted: dict[str, type]) -> Iterable[str]:
    for name, kind in wanted.items():
        value = attributes.get(name)
        if not isinstance(value, kind) or isinstance(value, bool):
            yield f"{place}: attribute `{name}` is missing or not {kind.__name__}"
        elif kind is float and not 0 <= value < float("inf"):
            yield f"{place}: attribute `{name}` is {value}; not finite, or negative"


def _dataset(path: str, dataset, root) -> Iterable[str]:
    import numpy as np

    from bakery.members import ERROR
    from bakery.store.tree import is_text, read_text

    if not dataset.units:
        yield f"{path}: no units"
    if not dataset.description or "\n" in dataset.description:
        yield f"{path}: no description in one line"
    if dataset.choices and dataset.data.size and not 0 <= dataset.data.min() <= dataset.data.max() < len(dataset.choices):
        yield f"{path}: a value that its enumeration does not name"
    if is_text(dataset):
        try:
            read_text(dataset)
        except UnicodeDecodeError:
            yield f"{path}: not UTF-8 text"
    elif dataset.data.dtype.kind in "fc" and not np.isfinite(dataset.data).all():
        yield f"{path}: not finite"
    if path.endswith(ERROR):
        try:
            of = root[path.removesuffix(ERROR)]
        except KeyError:
            yield f"{path}: standard errors of nothing"
            return
        if getattr(getattr(of, "data", None), "shape", None) != dataset.data.shape:
            yield f"{path}: not of the shape of {path.removesuffix(ERROR)}"
        elif of.units != dataset.units:
            yield f"{path}: its units are {dataset.units!r}, those of {path.removesuffix(ERROR)} {of.units!r}"
        elif (dataset.data < 0).any():
            yield f"{path}: a negative standard error"


def _outputs(name: str, group, stage) -> Iterable[str]:
    """Datasets that the stage declares."""
    from bakery.store.tree import Dataset

    for output in stage.outputs:
        places = _places(group, output.path.split("/"))
        if not places and not output.optional:
            yield f"{name}/{output.path}: missing"
        for path, member in places.items():
            if member is None and not output.optional:
                yield f"{name}/{path}: missing"
            elif isinstance(member, Dataset) and member.units != output.units:
                yield f"{name}/{path}: its units are {member.units!r}, not {output.units!r}"


def _places(group, parts: list[str]) -> dict:
    """Where a declared path leads in a group; a part in capitals stands for every group there is.  None where nothing is."""
    from bakery.store.tree import Group

    head, *rest = parts
    if head.isupper():
        heads = [name for name, member in group.members.items() if isinstance(member, Group)]
    else:
        heads = [head]
    places = {}
    for name in heads:
        member = group.members.get(name)
        if rest:
            inner = _places(member, rest) if isinstance(member, Group) else {"/".join(rest): None}
            places |= {f"{name}/{path}": found for path, found in inner.items()}
        else:
            places[name] = member
    return places


def physics(root) -> list[str]:
    """What the stages' own checks say of their groups."""
    broken = []
    for stage in _stages(root):
        try:
            broken += [f"{stage.name}: {rule}" for rule in stage.check(root.members[stage.name])]
        except Exception as error:  # a check trips over a group that lacks what it needs: the contract says what
            broken.append(f"{stage.name}: its rules cannot be checked ({type(error).__name__}: {error})")
    return broken


def _stages(root) -> list:
    """The declaration of each stage that the asset holds; of two that fill one group, the one that needs most of it."""
    from bakery.stages import all_stages
    from bakery.store.tree import Group

    chosen = {}
    for stage in all_stages():
        if isinstance(root.members.get(stage.name), Group) and all(need in root.members for need in stage.needs) \
                and len(stage.needs) >= len(getattr(chosen.get(stage.name), "needs", ())):
            chosen[stage.name] = stage
    return list(chosen.values())


def _plain(path: str, error: Exception) -> str:
    """An AssetError's text without the path, for it is known; `container` where it names no place."""
    text = str(error).removeprefix(f"{path}: ").removeprefix("damaged: ")
    return text if text.startswith(("container: ", "the root")) else f"container: {text}"
