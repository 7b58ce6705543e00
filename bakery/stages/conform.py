"""Whether an asset is what its stages declare: names, shapes, types, units, ranges and sizes, and what else readers count on.

Every `bakery.open` asks, so this is quick and imports no physics; `verify` adds the stages' own rules.  Places are named as in
the asset, findings are one sentence each.
"""

import math
import re
from collections import ChainMap
from collections.abc import Iterable, Mapping
from itertools import chain

import numpy as np

from bakery.errors import AssetError
from bakery.stages import all_stages
from bakery.stages.coordinates import BIAS, ERROR
from bakery.stages.declaration import Output, Stage
from bakery.store.tree import TEXT, Dataset, Group, is_text, read_text

STAGE_ATTRIBUTES = {"stage": str, "stage_version": int, "input_hash": str, "content_hash": str, "tolerance": float,
                    "achieved_error": float, "error_measure": str}
ROOT_ATTRIBUTES = {"format": str, "format_version": int, "name": str, "bakery_version": str, "content_hash": str}
PROVENANCE = {"seconds": float, "peak_memory": float, "workers": int, "bakery_version": str, "finished": str}
SHARED = "LA"  # letters that are one length in the whole asset
# of an axis, by its letter
LONGEST = {"L": 4096, "A": 1_000_000, "R": (1 << 20) + 1, "S": 4096, "F": 5_000_000, "V": 5_000_000, "N": 1 << 31}
OTHERS = 1_000_000
EMPTY = "NK"  # letters of axes that may be empty: the tables of a medium that scatters nothing
FAMILY = "family"  # group of the file of a family, which is held to `bakery.family.tree`
LARGEST = 1e100  # squares and cubes of what is stored stay within floating point
ROUNDING = 1e-9  # of shares and angles
_TERM = re.compile(r"(?:([A-Z])(?: ([+-]) (\d+))?|(\d+))")


def check(path: str, root: Group) -> None:
    """AssetError that names the first place where an asset departs from what its stages declare.

    What no stage declares is let pass: other hands, and later versions, may add to an asset.
    """
    departures = declared(root)
    if departures:
        rest_of_them = f" and {len(departures) - 1} more" if len(departures) > 1 else ""
        raise AssetError(f"{path}: damaged, or not written by bakery: {departures[0]}{rest_of_them}; `bake verify` lists all")


def parsed(path: str, data: bytes) -> Group:
    """The tree in an asset's bytes, which is what its stages declare; AssetError names `path`."""
    from bakery.store.read import parse

    root = parse(path, data)
    check(path, root)
    return root


def declared(root: Group) -> list[str]:
    """Where a tree departs from what its stages declare, in words: what readers count on."""
    departures = [*_root(root), *_stage_groups(root)]
    # sums and indices over what may not even be an array would only trip
    return departures or [f"{stage.name}: {rule}" for stage in _declared_by(root) for rule in stage.sound(root[stage.name])]


def faults(root: Group) -> list[str]:
    """Where a tree departs from `docs/asset-format.md`, physics apart."""
    of_datasets = (fault for path, member in root.walk() if isinstance(member, Dataset) for fault in _dataset(path, member, root))
    return list(dict.fromkeys([*declared(root), *_others(root), *of_datasets]))


def violations(root: Group) -> list[str]:
    """`faults`; where there are none, the rules of its stages' physics that a tree breaks."""
    return faults(root) or [f"{stage.name}: {rule}" for stage in stages_of(root) for rule in stage.check(root[stage.name])]


def broken(stage: Stage, group: Group) -> list[str]:
    """Where a group departs from what its stage declares; where nowhere, the rules of the stage's physics that it breaks."""
    departures = [*_outputs(stage.name, group, stage.outputs, {}), *_together(stage, group)]
    return departures or list(stage.sound(group)) or list(stage.check(group))


def stages_of(root: Group) -> list[Stage]:
    """The declaration of each stage that the asset holds; of two that fill one group, the one that needs most of it."""
    chosen: dict[str, Stage] = {}
    for stage in all_stages():
        if isinstance(root.members.get(stage.name), Group) and all(need in root.members for need in stage.needs) \
                and len(stage.needs) >= len(getattr(chosen.get(stage.name), "needs", ())):
            chosen[stage.name] = stage
    return list(chosen.values())


def _declared_by(root: Group) -> list[Stage]:
    """What each group is held to: of one whose upstream groups are gone the declaration that knows most of its members."""
    def members_known(stage):
        return len({output.path.partition("/")[0] for output in stage.outputs} & root[stage.name].members.keys())

    chosen = {stage.name: stage for stage in stages_of(root)}
    others = [stage for stage in all_stages() if stage.name in root.groups and stage.name not in chosen]
    chosen |= {stage.name: stage for stage in sorted(others, key=members_known)}
    return [stage for stage in all_stages() if stage in chosen.values()]


# ---- what every asset has


def _root(root: Group) -> Iterable[str]:
    yield from _attributes("root", root.attributes, ROOT_ATTRIBUTES)
    recipe, wavelength, provenance = (root.members.get(name) for name in ("recipe", "wavelength", "provenance"))
    if recipe is None or not is_text(recipe) or not _decodes(recipe):
        yield "recipe: missing, or not UTF-8 text in a dataset of bytes"
    if not isinstance(wavelength, Dataset) or wavelength.data.ndim != 1 or not 0 < wavelength.data.size <= LONGEST["L"] \
            or wavelength.data.dtype.kind != "f" or wavelength.units != "um":
        yield f"wavelength: missing, or not an array (L,) in um of up to {LONGEST['L']} numbers"
    elif not (wavelength.data > 0).all() or not (wavelength.data < LARGEST).all():
        yield "wavelength: not positive and finite"
    elif len(np.unique(wavelength.data)) < wavelength.data.size:
        yield "wavelength: holds one of them twice"
    for name, spent in (provenance.members if isinstance(provenance, Group) else {}).items():
        if isinstance(spent, Group):
            present = {key: kind for key, kind in PROVENANCE.items() if key in spent.attributes}
            yield from _attributes(f"provenance/{name}", spent.attributes, present)
            yield from (f"provenance/{name}/{key}: not text" for key, member in spent.members.items()
                        if not is_text(member) or not _decodes(member))


def _attributes(where: str, attributes: Mapping, wanted: Mapping[str, type]) -> Iterable[str]:
    for name, kind in wanted.items():
        value = attributes.get(name)
        if not isinstance(value, kind) or isinstance(value, bool):
            yield f"{where}: attribute `{name}` is missing or not {kind.__name__}"
        elif kind is float and not 0 <= value < LARGEST:
            yield f"{where}: attribute `{name}` is {value}; not finite, or negative"


def _others(root: Group) -> Iterable[str]:
    """Rules of groups that no stage declares."""
    if not isinstance(root.members.get("provenance"), Group):
        yield "provenance: missing"
    groups = {"recipe", "wavelength", "provenance", FAMILY, *(stage.name for stage in _declared_by(root))}
    for name in [name for name in root.members if name not in groups]:
        member = root.members[name]
        if isinstance(member, Group):
            yield from _stage_attributes(name, member)
        else:
            yield f"{name}: does not belong into the root of an asset"


def _stage_attributes(name: str, group: Group) -> Iterable[str]:
    yield from _attributes(name, group.attributes, STAGE_ATTRIBUTES)
    if group.attributes.get("stage") != name:
        yield f"{name}: its attribute `stage` is {group.attributes.get('stage')!r}"


def _dataset(path: str, dataset: Dataset, root: Group) -> Iterable[str]:
    data = dataset.data
    if not dataset.units:
        yield f"{path}: no units"
    if not dataset.description or "\n" in dataset.description:
        yield f"{path}: no description in one line"
    if dataset.choices and data.size and not 0 <= data.min() <= data.max() < len(dataset.choices):
        yield f"{path}: a value that its enumeration does not name"
    if is_text(dataset) and not _decodes(dataset):
        yield f"{path}: not UTF-8 text"
    elif data.dtype.kind in "fc" and not np.isfinite(data).all():
        yield f"{path}: not finite"
    for suffix, words in ((ERROR, "standard errors"), (BIAS, "biases")):
        if path.endswith(suffix):
            yield from _error_of(path, path.removesuffix(suffix), words, dataset, root)


def _decodes(dataset: Dataset) -> bool:
    try:
        read_text(dataset)
    except UnicodeDecodeError:
        return False
    return True


def _error_of(path: str, name: str, words: str, dataset: Dataset, root: Group) -> Iterable[str]:
    """How the `words` at `path` are not those of the dataset `name`."""
    try:
        of = root[name]
    except KeyError:
        yield f"{path}: {words} of nothing"
        return
    if getattr(getattr(of, "data", None), "shape", None) != dataset.data.shape:
        yield f"{path}: not of the shape of {name}"
    elif of.units != dataset.units:
        yield f"{path}: its units are {dataset.units!r}, those of {name} {of.units!r}"
    elif dataset.data.dtype.kind not in "fiu":
        yield f"{path}: not numbers"
    elif (dataset.data < 0).any():
        yield f"{path}: negative {words}"


# ---- what the stages declare


def _stage_groups(root: Group) -> Iterable[str]:
    wavelength = root.members.get("wavelength")
    shared = {"L": wavelength.data.size} if isinstance(wavelength, Dataset) else {}
    for stage in _declared_by(root):  # upstream ones first: a wrong length is laid to the group that departs from them
        group = root.members[stage.name]
        yield from _stage_attributes(stage.name, group)
        yield from _outputs(stage.name, group, stage.outputs, shared)
        yield from _together(stage, group)


def _together(stage: Stage, group: Group) -> Iterable[str]:
    """Members that are missing although others are there that come with them."""
    for paths in stage.together:
        present, absent = {}, {}
        for where, scope, member in chain.from_iterable(_places(group, path.split("/")) for path in paths):
            (absent if member is None else present).setdefault(scope, where)
        yield from (f"{stage.name}/{absent[scope]}: missing beside {present[scope]}" for scope in absent if scope in present)


def _outputs(name: str, group: Group, outputs: Iterable[Output], shared: dict[str, int]) -> Iterable[str]:
    """Datasets that a stage declares; `shared` learns the lengths of letters of the whole asset."""
    lengths: dict[str, dict[str, int]] = {}
    for output in outputs:
        places = list(_places(group, output.path.split("/")))
        if not places and not output.optional:
            yield f"{name}/{output.path}: missing"
        for path, scope, member in places:
            where = f"{name}/{path}"
            if member is None:
                if not output.optional:
                    yield f"{where}: missing"
            elif isinstance(member, Group):
                yield f"{where}: a group, where a dataset belongs"
            else:
                known_lengths = ChainMap(lengths.setdefault(scope, {}), lengths.setdefault("", {}), shared)
                yield from (f"{where}: {fault}" for fault in _declared(member, output, known_lengths, shared))


def _places(group: Group, parts: list[str], above: str = "", scope: str = "") -> Iterable[tuple]:
    """Where a declared path leads: path, the part of it up to its last word in capitals, the member or None.

    A word in capitals stands for every group there is; none where there is no group.
    """
    head, *inner = parts
    wild = head.isupper()
    for name in group.groups if wild else [head]:
        member, path = group.members.get(name), above + name
        if not inner:
            yield path, scope, member
        elif isinstance(member, Group):
            yield from _places(member, inner, path + "/", path if wild else scope)
        else:
            yield path + "/" + "/".join(inner), scope, None


def _declared(dataset: Dataset, output: Output, known_lengths: Mapping[str, int], shared: dict[str, int]) -> Iterable[str]:
    """How a dataset departs from its declaration; `known` holds the lengths of letters and learns new ones."""
    data = dataset.data
    if dataset.units != output.units:
        yield f"its units are {dataset.units!r}, not {output.units!r}"
    if output.units == TEXT:
        if not is_text(dataset) or not _decodes(dataset):
            yield "not UTF-8 text in an array of bytes"
        return
    if dataset.choices != output.choices:
        yield f"an enumeration of {', '.join(dataset.choices) or 'nothing'}, not of {', '.join(output.choices) or 'nothing'}"
        return
    kinds = "iu" if output.whole or output.choices else "fi" if output.scaled else "f"
    if data.dtype.kind not in kinds or data.dtype.str[1:] == "f2":
        yield f"its type is {data.dtype}; {'integers' if output.whole or output.choices else 'float32 or float64'} belong there"
        return
    fault = _shape(data.shape, output.shape, known_lengths, shared)
    if fault:
        yield fault
    elif data.size:
        yield from _values(data, output, known_lengths)


def _values(data: np.ndarray, output: Output, known_lengths: Mapping[str, int]) -> Iterable[str]:
    if not np.isfinite(data).all():
        yield "not finite"
        return
    least, most = (0, len(output.choices) - 1) if output.choices else output.within
    most = _length(most, known_lengths) if isinstance(most, str) else most
    least, most = max(least, -LARGEST), min(most, LARGEST)
    low, high = float(data.min()), float(data.max())
    margin = ROUNDING * max(-least, most) if max(-least, most) < 10 else 0.0
    if low < least - margin or high > most + margin:
        far = f"{low:.6g}, below {least:g}" if low < least - margin else f"{high:.6g}, above {most:g}"
        yield f"holds {far}" + (", a number that its enumeration does not name" if output.choices else "")


def _shape(shape: tuple[int, ...], declared: str, known_lengths: Mapping[str, int], shared: dict[str, int]) -> str:
    """What is wrong with a shape, or nothing."""
    terms = _TERM.findall(declared)
    if len(terms) != len(shape):
        return f"its shape is {shape}, not {declared}"
    for (letter, sign, offset, number), length in zip(terms, shape, strict=True):
        if number:
            if length != int(number):
                return f"its shape is {shape}, not {declared}"
            continue
        base = length - (int(sign + offset) if offset else 0)
        if letter not in known_lengths:
            if base > LONGEST.get(letter, OTHERS) or base < (letter not in EMPTY):
                return f"its shape is {shape}; {letter} of {declared} is 1 to {LONGEST.get(letter, OTHERS)}"
            (shared if letter in SHARED else known_lengths)[letter] = base
        elif known_lengths[letter] != base:
            return f"its shape is {shape}, not {declared} with {letter} = {known_lengths[letter]}"
    return ""


def _length(term: str, known_lengths: Mapping[str, int]) -> float:
    """The value of `V - 1`; without bound where V is not known, as its dataset is missing."""
    letter, sign, offset, _ = _TERM.fullmatch(term).groups()
    return known_lengths[letter] + (int(sign + offset) if offset else 0) if letter in known_lengths else math.inf
