"""Variables of a NetCDF file from its bytes: NetCDF 3 through SciPy, NetCDF 4, which is HDF5, through h5py."""

import io
import math
import struct
from typing import NamedTuple

import numpy as np

from bakery.grammar.grids import check_stored
from bakery.grammar.text import show
from bakery.grammar.units import Wrong

BYTES = 512 << 20  # of a file
MOST = 1 << 27  # values of a variable
CLASSIC, HDF5 = (b"CDF\x01", b"CDF\x02"), b"\x89HDF\r\n\x1a\n"
# what the libraries raise at damaged files
_DAMAGED = (OSError, ValueError, KeyError, RuntimeError, EOFError, TypeError, IndexError, AssertionError, OverflowError,
            MemoryError, AttributeError, struct.error)


class Variable(NamedTuple):
    """Numbers as they are stored, and the text of the attribute `units`, "" where there is none."""

    values: np.ndarray
    units: str


def read(data: bytes, wanted: frozenset[str]) -> dict[str, Variable]:
    """The variables of those names at the root of a file; raises `Wrong`."""
    if not data.startswith((*CLASSIC, HDF5)):
        raise Wrong("found no NetCDF file" + (" but an empty one" if not data else ""),
                    "expected NetCDF 3 or 4 (.nc, .cdf)")
    try:
        with np.errstate(all="ignore"):  # bytes that are no numbers
            variables = _hdf5(data, wanted) if data.startswith(HDF5) else _classic(data, wanted)
    except _DAMAGED as error:
        words = str(error).splitlines()
        raise Wrong(f"found a file that cannot be read ({show(words[0] if words else type(error).__name__)[1:-1]})",
                    "expected a NetCDF file that was written whole") from None
    return variables


def _classic(data: bytes, wanted) -> dict[str, Variable]:
    from scipy.io import netcdf_file

    with netcdf_file(io.BytesIO(data), "r", mmap=False) as file:
        variables = {}
        for name in wanted & file.variables.keys():
            variable = file.variables[name]
            _check(name, variable.shape, variable.data.dtype)
            variables[name] = Variable(np.array(variable.data, float), _units(getattr(variable, "units", "")))
            _packed(name, vars(variable).get("_attributes", {}))
        return variables


def _hdf5(data: bytes, wanted) -> dict[str, Variable]:
    import h5py

    with h5py.File(io.BytesIO(data), "r") as file:
        variables = {}
        for name in file.keys() & wanted:
            if not isinstance(file.get(name, getlink=True), h5py.HardLink) or not isinstance(file[name], h5py.Dataset):
                raise Wrong(f"found {show(name)}, which is no variable in the file itself", "expected numbers")
            variable = file[name]
            _check(name, variable.shape or (), variable.dtype)
            check_stored(file, variable, name, "variable")
            _packed(name, variable.attrs)
            variables[name] = Variable(np.array(variable[()], float), _hdf5_units(name, variable))
        return variables


def _hdf5_units(name: str, variable) -> str:
    if "units" not in variable.attrs:
        return ""
    if variable.attrs.get_id("units").dtype.kind != "S":
        # of strings of variable length HDF5 searches a damaged heap for ever
        raise Wrong(f"found the units of {show(name)} as a string of variable length",
                    "expected characters, as most programs write them: "
                    "`nccopy -k nc6 old.nc new.nc`, or xarray's to_netcdf with format NETCDF3_64BIT")
    return _units(variable.attrs["units"])


def _units(value) -> str:
    text = value.decode("utf-8", "replace") if isinstance(value, bytes) else value if isinstance(value, str) else ""
    return " ".join(text.split())


def _packed(name: str, attributes) -> None:
    if "scale_factor" in attributes or "add_offset" in attributes:
        raise Wrong(f"found {show(name)} packed into integers (scale_factor)", "expected the numbers themselves: "
                    "`ncpdq -U packed.nc plain.nc` unpacks them")


def _check(name: str, shape, dtype) -> None:
    if dtype.kind not in "fiu":
        raise Wrong(f"found {show(name)} of type {dtype}", "expected real numbers")
    if math.prod(shape) > MOST:
        raise Wrong(f"found {show(name)} of {math.prod(shape):,} values", f"expected at most {MOST:,}")
