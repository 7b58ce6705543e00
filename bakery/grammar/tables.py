"""Tables in CSV files: checked columns of numbers, or problems that name the table's own lines.

# name: water                    comment lines, `key: value`, first
wavelength_um,n,k                optional names of the columns; a name may end in its unit
0.200,1.42370,1.100e-07
"""

import math
import re
from dataclasses import dataclass
from typing import NoReturn

import numpy as np

from bakery.errors import Problem
from bakery.grammar.text import Source, show

MAX_ROWS, MAX_COMMENTS, MAX_PROBLEMS = 1_000_000, 1_000, 5


@dataclass(frozen=True)
class Column:
    """A column: its name, the factor of each unit that its name may end in (first: the default), and its bounds.

    `required` says whether the table must have it; `named` whether its unit has to be said.
    """

    name: str
    units: dict[str, float]
    least: float
    above: bool = False
    required: bool = True
    named: bool = False


WAVELENGTH = Column("wavelength", {"um": 1.0, "nm": 1e-3}, 0.0, above=True)
INDEX = (WAVELENGTH, Column("n", {}, 0.0, above=True), Column("k", {}, 0.0, required=False))
SIZES = (Column("radius", {"um": 1.0, "nm": 1e-3, "mm": 1e3}, 0.0), Column("density", {}, 0.0))
PHASE = (Column("theta", {"deg": math.pi / 180, "rad": 1.0}, 0.0, named=True), Column("value", {}, 0.0))


_NUMERIC = re.compile(r"[0-9eE+\-., \t]*")


class BadTable(Exception):
    """A table's problems."""

    def __init__(self, problems: list[Problem]):
        super().__init__("; ".join(map(str, problems)))
        self.problems = problems


class Checked:
    """Collects what is wrong with a file of numbers: `problems`; raises `BadTable` after MAX_PROBLEMS, and to `stop`."""

    def __init__(self, label: str, key: str):
        self.label, self.key, self.problems, self.lines = label, key, [], []

    def report(self, line: int | None, found: str, expected: str, column: int | None = None) -> None:
        """With a column, the message shows that place of the line."""
        excerpt = ""
        if line is not None and column is not None:
            excerpt = Source(self.label, self.lines[line - 1][:100_000]).excerpt(1, column)
        self.problems.append(Problem(self.label, line, column, self.key, found, expected, excerpt))
        if len(self.problems) >= MAX_PROBLEMS:
            raise BadTable(self.problems)

    def stop(self, line: int | None, found: str, expected: str, column: int | None = None) -> NoReturn:
        """A problem after which nothing more can be read."""
        self.report(line, found, expected, column)
        raise BadTable(self.problems)


class Reader(Checked):
    """Reads the columns of one table; `lines` holds its text."""

    def __init__(self, data: bytes, label: str, key: str, columns: tuple[Column, ...]):
        super().__init__(label, key)
        self.columns, self.data = columns, data
        self.lows = [math.nextafter(column.least, math.inf) if column.above else column.least for column in columns]

    def read(self) -> np.ndarray:
        if b"\0" in self.data:
            self.stop(self.data.count(b"\n", 0, self.data.index(b"\0")) + 1, "found a NUL byte", "expected a text file")
        if self.data.count(b"\n") > MAX_ROWS + MAX_COMMENTS:
            self.stop(None, f"found more than {MAX_ROWS:,} rows", "expected a smaller table")
        try:
            text = self.data.decode("utf-8-sig")
        except UnicodeDecodeError as error:
            self.stop(self.data.count(b"\n", 0, error.start) + 1, f"found the byte 0x{self.data[error.start]:02x}",
                      "expected UTF-8 text")
        self.lines = re.split(r"\r\n|\r|\n", text)
        del text
        rows, factors, width = [], None, None
        for number, line in enumerate(self.lines, 1):
            if not line.strip() or line.lstrip().startswith("#"):
                self._comment(number, line)
                continue
            if width is None:
                width, factors, named = self._head(number, line)
                if named:
                    continue
            row = self._row(number, line, width)
            if row is not None:
                rows.append(row)
            if len(rows) > MAX_ROWS:
                self.stop(number, f"found more than {MAX_ROWS:,} rows", "expected a smaller table")
        if not self.problems and len(rows) < 2:
            self.report(None, f"found {len(rows)} row{'s' * (len(rows) != 1)} of numbers", "expected at least 2")
        if self.problems:
            raise BadTable(self.problems)
        return self._ascending(np.array(rows, dtype=float), factors)

    def _comment(self, number: int, line: str) -> None:
        statement = line.strip("# \t").partition(":")
        if statement[0].strip().lower() == "relative_to" and statement[2].strip().lower() not in ("vacuum", ""):
            self.report(number, f"found values relative to {show(statement[2].strip())}",
                        "expected them relative to vacuum (multiply n in air by 1.00028) and `# relative_to: vacuum`")

    def _head(self, number: int, line: str) -> tuple[int, list[float], bool]:
        """Number of columns, factor of each, and whether the line names them."""
        if line.count(",") >= 100:
            self.stop(number, "found more than 100 columns", f"expected {self._names()}")
        cells = [cell.strip() for cell in line.split(",")]
        optional = sum(not column.required for column in self.columns)
        fits = len(self.columns) - optional <= len(cells) <= len(self.columns)
        if not fits:
            self.stop(number, f"found {len(cells)} column{'s' * (len(cells) != 1)}",
                      f"expected {self._names()}, separated by commas", 1)
        named = not any(finite_number(cell) is not None for cell in cells)
        factors = []
        for cell, column in zip(cells, self.columns):
            units = [*column.units] or [""]
            if named:
                match = re.fullmatch(rf"(.*?)(?:[_ (\[]+({'|'.join(filter(None, units)) or '$'})[)\]]?)?", cell)
                unit = match.group(2) or ""
                # n, k and the like must stand in this order; density may be called dn/dr and so on
                if column.name in ("n", "k", "wavelength", "radius", "theta") and match.group(1).strip().lower() != column.name:
                    self.report(number, f"found the column {show(cell)}", f"expected {self._names()}", 1)
                    unit = unit or units[0]
            else:
                unit = "" if column.named else units[0]
            if column.named and not unit:
                self.report(number, f"found no unit for the column {column.name}", f"expected a first line with {self._names()}",
                            1)
            factors.append(column.units.get(unit or units[0], 1.0))
        if self.problems:
            raise BadTable(self.problems)
        return len(cells), factors, named

    def _names(self) -> str:
        return "the columns " + ",".join(c.name + ("_" + next(iter(c.units)) if c.units else "") for c in self.columns)

    def _row(self, number: int, line: str, width: int) -> list[float] | None:
        if _NUMERIC.fullmatch(line) and line.count(",") + 1 == width:  # the common case: five times as fast as cell by cell
            try:
                values = [float(cell) for cell in line.split(",")]
            except ValueError:
                values = [math.nan]
            if all(low <= value < math.inf for value, low in zip(values, self.lows)):
                return values
        count = line.count(",") + 1
        if count != width:
            self.report(number, f"found {count} column{'s' * (count != 1)}", f"expected {width}, as in the rows before", 1)
            return None
        values, offset = [], 0
        for cell, column in zip(line.split(","), self.columns):
            value = finite_number(cell.strip())
            at = offset + len(cell) - len(cell.lstrip()) + 1
            if value is None:
                self.report(number, f"found {show(cell.strip())} under {column.name}", "expected a finite number", at)
            elif value < column.least or column.above and value == column.least:
                self.report(number, f"found {show(cell.strip())} under {column.name}",
                            f"expected {'a value above' if column.above else 'at least'} {column.least:g}", at)
            values.append(value)
            offset += len(cell) + 1
        return values

    def _ascending(self, rows: np.ndarray, factors: list[float]) -> np.ndarray:
        columns = (rows * factors).T
        late = np.flatnonzero(np.diff(columns[0]) <= 0)
        if len(late):
            numbered = [n for n, line in enumerate(self.lines, 1) if line.strip() and not line.lstrip().startswith("#")]
            line = numbered[len(numbered) - len(rows) + int(late[0]) + 1]
            cell = show(self.lines[line - 1].split(",")[0].strip())
            self.stop(line, f"found {cell} after a {self.columns[0].name} that is not smaller", "expected ascending order", 1)
        return columns


def finite_number(text: str) -> float | None:
    """A finite number, or None."""
    if len(text) > 400 or not re.fullmatch(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", text, re.ASCII):
        return None
    value = float(text)
    return value if math.isfinite(value) else None


def read(data: bytes, label: str, key: str, columns: tuple[Column, ...]) -> np.ndarray:
    """The columns of a table, (C, T), in the units of the columns' factors; raises `BadTable`."""
    return Reader(data, label, key, columns).read()
