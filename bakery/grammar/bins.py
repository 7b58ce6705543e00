"""Histograms of sizes in CSV files: what an instrument counted in its bins, by edges or by centres.

diameter_lower_um,diameter_upper_um,dN      or  radius_um,dN/dlnr  and the like: the line of names says what the columns are
0.30,0.40,152
"""

import re
from typing import NamedTuple

import numpy as np

from bakery.errors import Problem
from bakery.grammar.tables import BadTable, Column, Reader
from bakery.grammar.text import show

MOST = 4096  # bins
_CLOSE = 1e-3  # relative distance of two edges that are one: files have few digits
_POWERS = {"n": 0.0, "s": 2.0, "v": 3.0}
_SIZE = re.compile(r"(radius|diameter)(?:_(lower|upper))?_(um|nm|mm)")
_AMOUNT = re.compile(r"d([NSV])(?:/d(ln|log10|log|)(?:r|Dp?))?", re.IGNORECASE)
_NAMES = ("a first line with the names radius_um or diameter_um (centres of bins), or radius_lower_um,radius_upper_um or "
          "diameter_lower_um,diameter_upper_um (edges); then dN, dN/dlnr, dN/dlogD, dN/dr or the like, S or V for N; also nm, mm")


class Bins(NamedTuple):
    """What was counted."""

    edge: np.ndarray  # (B + 1,) um, radii, ascending
    amount: np.ndarray  # (B,) in any unit
    power: float  # of the radius that was counted: 0 number, 2 surface, 3 volume


def read(data: bytes, label: str, key: str) -> Bins:
    """The bins of a file; raises `BadTable`.

    Centres stand half-way between edges in ln r; the outer edges are as far from their centres as the inner ones.  Edges of
    neighbours that differ by less than 0.1 % are one; a gap is an empty bin.
    """
    names, kind = _head(data, label, key)
    sizes = [_SIZE.fullmatch(name) for name in names[:-1]]
    half = 0.5 if sizes[0][1] == "diameter" else 1.0
    units = {"um": half, "nm": 1e-3 * half, "mm": 1e3 * half}
    columns = (*(Column(name.removesuffix(f"_{match[3]}"), units, 0.0, above=True) for name, match in zip(names, sizes)),
               Column("amount", {}, 0.0))
    reader = Reader(data, label, key, columns)
    rows = reader.read()
    if rows.shape[1] > MOST:
        reader.stop(None, f"found {rows.shape[1]:,} bins", f"expected at most {MOST:,}")
    edge, value = _of_centres(*rows) if len(rows) == 2 else _of_edges(reader, *rows)
    if kind[2] is None:  # dN: no "per"
        amount = value
    else:
        amount = value * (np.diff(edge) if not kind[2] else np.log(edge[1:] / edge[:-1]))
    if not amount.max() > 0:
        reader.stop(None, "found bins that are all empty", "expected an amount above 0")
    return Bins(edge, amount, _POWERS[kind[1].lower()])


def _head(data: bytes, label: str, key: str):
    """Names of the columns, and the match of what was counted."""
    for number, line in enumerate(data.decode("utf-8-sig", "replace").splitlines(), 1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        names = [re.sub(r"\s+", "", name) for name in line[:1000].split(",")]
        sizes, kind = [_SIZE.fullmatch(name) for name in names[:-1]], _AMOUNT.fullmatch(names[-1])
        sides = [match and match[2] for match in sizes]
        fits = kind and all(sizes) and (sides == [None] or sides == ["lower", "upper"] and sizes[0][1] == sizes[1][1]
                                        and sizes[0][3] == sizes[1][3])
        if fits:
            return names, kind
        raise BadTable([Problem(label, number, None, key, f"found {show(line.strip(), 80)}", f"expected {_NAMES}")])
    raise BadTable([Problem(label, None, None, key, "found no line of names", f"expected {_NAMES}")])


def _of_centres(centre, value):
    inner = np.sqrt(centre[1:] * centre[:-1])
    return np.concatenate([[centre[0] ** 2 / inner[0]], inner, [centre[-1] ** 2 / inner[-1]]]), value


def _of_edges(reader, lower, upper, value):
    numbered = [n for n, line in enumerate(reader.lines, 1) if line.strip() and not line.lstrip().startswith("#")][1:]
    edge, amount = [float(lower[0])], []
    for i, (a, b, v) in enumerate(zip(lower.tolist(), upper.tolist(), value.tolist())):
        below, above = (show(cell.strip()) for cell in reader.lines[numbered[i] - 1].split(",")[:2])
        if not a < b:
            reader.stop(numbered[i], f"found a bin from {below} to {above}", "expected an upper edge above the lower one", 1)
        if a < edge[-1] * (1 - _CLOSE):
            reader.stop(numbered[i], f"found a bin from {below}, which is below the upper edge of the one before",
                        "expected bins that do not overlap", 1)
        if a > edge[-1] * (1 + _CLOSE):
            edge.append(a)
            amount.append(0.0)
        edge.append(b)
        amount.append(v)
    return np.array(edge), np.array(amount)
