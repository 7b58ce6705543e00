"""What `asset.query(…)` and `bake query` answer: a baked value at a path, or one looked up at arguments."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from numbers import Real
from typing import TYPE_CHECKING

import numpy as np

from bakery.asset.lookup import lookup
from bakery.errors import UsageError
from bakery.family.tree import is_family
from bakery.grammar.text import closest, show
from bakery.grammar.units import ANGLE, LENGTH, WAVELENGTH, naming, parse_any
from bakery.stages import all_stages
from bakery.stages.conform import FAMILY
from bakery.stages.declaration import Answer, Query
from bakery.store.tree import Attribute, Dataset, Group, is_text, read_text

if TYPE_CHECKING:
    from bakery.asset import Asset, Family

ARGUMENTS = "arguments are wavelength=0.55um, theta=10deg, radius=5um"


def ask(asset: Asset | Family, path: str, arguments: Mapping[str, str | float | Iterable[float]]) -> Answer | Attribute:
    """The value at a path of an asset; text and attributes as they are, all else as an `Answer`.

    path : such as `medium/phase`
    arguments : name -> text with its unit ("10 deg", "[0, 90] deg"), or one or more numbers: wavelength and radius in um, theta
        in rad, those of a stage's own queries as it says

    Raises UsageError : a path that the asset does not hold, an argument that has no effect there or lies outside of what is
        stored
    """
    queries = {query.path: query for stage in all_stages() for query in stage.queries}
    root, path = asset.tree, path.strip("/")
    # tables of a family have wavelength and theta beside its own axes
    swept = root[f"{FAMILY}/axes"].members.keys() - {"wavelength", "theta"} if is_family(root) else ()
    if name := next((name for name in arguments if name in swept), ""):
        raise UsageError(f"{path}: {name} is an axis of the family; --at {name}=…, in Python `at({name}=…)`, takes the asset of "
                         "a place, which is asked for medium/…")
    values = {name: _value(name, value, queries, path) for name, value in arguments.items()}
    if path in queries and queries[path].bare and not is_family(root):
        return queries[path].answer(asset, path, values)
    member = _find(asset.path, root, path)
    if path in queries and values:
        return queries[path].answer(asset, path, values)
    if isinstance(member, Group):
        content = ", ".join([*member.members, *member.attributes])
        raise UsageError(f"{asset.path}: {path} is a group; it holds {content}: ask for one of them, "
                         f"such as {path}/{content.split(',')[0]}")
    if isinstance(member, Dataset) and not is_text(member):
        return lookup(root, path, values)
    if values:
        raise UsageError(f"{path}: {next(iter(values))} has no effect on it; it takes no arguments")
    return read_text(member) if isinstance(member, Dataset) else member


def not_found(asset: str, path: str, names: list[str]) -> str:
    """What to say of a path that an asset does not hold: the nearest one, or what there is."""
    near = closest(path, names) or next((name for name in names if name.rpartition("/")[2] == path), "")
    hint = f"did you mean {near}?" if near else f"it holds {', '.join(name for name in names if '/' not in name)}"
    return f'{asset}: found no "{path}"; {hint}'


def _value(name: str, value, queries: Mapping[str, Query], path: str) -> float | tuple[float, ...]:
    """An argument in the unit of the lookup: lengths in um, angles in rad."""
    kinds = {"wavelength": WAVELENGTH, "theta": ANGLE, "radius": LENGTH}
    for query in (*queries.values(), *([queries[path]] if path in queries else [])):
        kinds |= query.arguments
    if name not in kinds:
        near = closest(name, kinds)
        askable = [ARGUMENTS, *(f"of {query.path} {query.example}" for query in queries.values())]
        raise UsageError(f'found "{name}"; ' + (f"did you mean {near}=…?" if near else "; ".join(askable)))
    if not isinstance(value, str):
        return _numbers(name, value)
    with naming(name):
        return parse_any(value, kinds[name])


def reals(value) -> tuple[float, ...]:
    """The real numbers of a number or an array of any shape; none where it holds anything else, or is empty."""
    try:
        numbers = np.ravel(value)
        # asked for, as float() also takes "0.55" and b"0.55", and of numpy's complex numbers the real part
        return tuple(map(float, numbers)) if all(isinstance(number, Real) for number in numbers) else ()
    except ValueError:  # lists of unequal lengths
        return ()
    except OverflowError:  # 10**400
        return (math.inf,)


def _numbers(name: str, value) -> float | tuple[float, ...]:
    """One or more finite numbers; UsageError for all else."""
    values = reals(value)
    if not values:
        raise UsageError(f"{name}: found {show(value)}; expected a number, several of them, or text with a unit")
    wrong = next((number for number in values if not math.isfinite(number)), None)
    if wrong is not None:
        raise UsageError(f"{name}: found {wrong:g}; expected a finite number")
    return values if np.ndim(value) else values[0]


def _find(asset: str, root: Group, path: str):
    """A dataset or group, or the value of an attribute (medium/achieved_error)."""
    if not path:
        return root
    try:
        return root[path]
    except KeyError:
        pass
    parent, _, name = path.rpartition("/")
    try:
        return getattr(root[parent] if parent else root, "attributes", {})[name]
    except KeyError:
        pass
    if is_family(root) and path.partition("/")[0] != FAMILY:
        raise UsageError(f"{asset}: is a family, so {path} is one of each of its places; --at says which")
    names = [name for name, _ in root.walk()]
    names += [f"{name}/{key}" for name, member in root.walk() for key in getattr(member, "attributes", ())]
    names += [query.path for stage in all_stages() for query in stage.queries if query.bare and "/" in query.path]
    raise UsageError(not_found(asset, path, names + list(root.attributes)))
