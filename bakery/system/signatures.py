"""Types of arguments of compiled kernels as JSON, and back.

A scalar is its name (`float64`); an array `float64[2C]`, by its dimensions and its order in memory (C, F or A), with `!` at the
end where it is read only; a tuple a list; a named tuple `{"module:Class": [...]}`.
"""

import re
from importlib import import_module

from numba.core import types

_ARRAY = re.compile(r"(\w+)\[(\d)([ACF])(!?)\]")


def written(kind):
    """A type as JSON; ValueError where there is no form for it."""
    if isinstance(kind, types.Array) and kind.aligned and isinstance(kind.dtype, (types.Number, types.Boolean)):
        return f"{kind.dtype}[{kind.ndim}{kind.layout}{'' if kind.mutable else '!'}]"
    if isinstance(kind, (types.NamedTuple, types.NamedUniTuple)):
        return {f"{kind.instance_class.__module__}:{kind.instance_class.__qualname__}": [written(field) for field in kind.types]}
    if isinstance(kind, (types.Tuple, types.UniTuple)):
        return [written(field) for field in kind.types]
    if isinstance(kind, (types.Number, types.Boolean)):
        return str(kind)
    raise ValueError(f"{kind}: neither a number, nor an array of numbers, nor a tuple of such")


def read(form):
    """The type that `written` wrote."""
    if isinstance(form, list):
        return types.BaseTuple.from_types([read(field) for field in form])
    if isinstance(form, dict):
        (name, fields), = form.items()
        return types.BaseTuple.from_types([read(field) for field in fields], by_name(name))
    if match := _ARRAY.fullmatch(form):
        dtype, ndim, layout, read_only = match.groups()
        return types.Array(getattr(types, _scalar(dtype)), int(ndim), layout, readonly=bool(read_only))
    return getattr(types, _scalar(form))


def by_name(name: str):
    """What `module:name` is."""
    module, attribute = name.split(":")
    return getattr(import_module(module), attribute)


def _scalar(name: str) -> str:
    return "boolean" if name == "bool" else name
