"""Refractive indices from files of other people: YAML of refractiveindex.info, text of the Aerosol Refractive Index Archive.

    DATA:                                  #SUBSTANCE=…
      - type: formula 2                    #FORMAT=WAVL N K
        wavelength_range: 0.3 2.5          0.300 1.520 1.0e-3
        coefficients: 0 1.03961212 …       0.400 1.518 0.9e-3
      - type: tabulated k
        data: |
            0.300 2.8607E-06
"""

import re
from typing import NamedTuple

import numpy as np

from bakery.errors import Problem, RecipeError
from bakery.grammar.tables import MAX_PROBLEMS, MAX_ROWS, BadTable, Checked, finite_number
from bakery.grammar.text import MAX_BYTES, Mapping, Scalar, Sequence, Source, decode, parse, show

_TABLES = {"tabulated nk": ("n", "k"), "tabulated n": ("n",), "tabulated k": ("k",)}
_ARIA = re.compile(rb"^[ \t]*#[ \t]*FORMAT[ \t]*=", re.MULTILINE)
_YAML = re.compile(rb"^DATA[ \t]*:", re.MULTILINE)
_IN_AIR = re.compile(r"relative to (the )?air\b", re.IGNORECASE)
_SEAM = 0.1  # two values at one wavelength, which 14 files of the database have where measurements join, differ by less
_SAID = ("n_is_absolute", "wavelength_is_vacuum")  # words of the database until 2024


class Tabulated(NamedTuple):
    """Values (T,) at wavelengths (T,) um, ascending."""

    wavelength: np.ndarray
    values: np.ndarray

    @property
    def range(self) -> tuple[float, float]:
        """um"""
        return float(self.wavelength[0]), float(self.wavelength[-1])


class Formula(NamedTuple):
    """n by the formula of a number, within a range in um."""

    number: int
    coefficients: tuple[float, ...]
    range: tuple[float, float]


class Constants(NamedTuple):
    """Optical constants of a material."""

    # n, k: each with a range of its own; k is None where the file has none
    n: Tabulated | Formula
    k: Tabulated | None
    in_air: bool | None = None  # n is relative to air, at wavelengths in air; None where nothing is said


def is_foreign(data: bytes, name: str) -> bool:
    """Whether a file is not a table of our own form."""
    return name.lower().endswith((".yml", ".yaml", ".ri")) or bool(_ARIA.search(data) or _YAML.search(data))


def read(data: bytes, name: str, key: str, fewest: dict[int, int], most: dict[int, int]) -> Constants:
    """The constants of a file; raises `BadTable`.

    fewest, most : number of a formula -> coefficients that it takes
    """
    label = show(name, 300)[1:-1]
    aria = _ARIA.search(data) or name.lower().endswith(".ri")
    reader = _Reader(label, key)
    try:
        constants = reader.aria(data) if aria else reader.yaml(data, fewest, most)
    except RecipeError as error:  # what the grammar refuses; it speaks of recipes
        raise BadTable([Problem(label, problem.line, problem.column, key, problem.found,
                                problem.expected.replace("recipe", "file"), problem.excerpt)
                        for problem in error.problems[:MAX_PROBLEMS]]) from None
    if reader.problems:
        raise BadTable(reader.problems)
    return constants


class _Reader(Checked):
    # ---- refractiveindex.info

    def yaml(self, data: bytes, fewest, most) -> Constants:
        if len(data) > MAX_BYTES:
            self.stop(None, f"found {len(data):,} bytes", f"expected at most {MAX_BYTES:,}; thin the table out, or write a CSV")
        source = Source(self.label, decode(data, self.label))
        tree = parse(source)
        if tree.problems:
            raise RecipeError(tree.problems)
        root = tree.root
        blocks = root.get("DATA") if isinstance(root, Mapping) else None
        if not isinstance(blocks, Sequence) or not all(isinstance(block, Mapping) for block in blocks) or not blocks:
            self.stop(None, "found no list DATA", "expected a file of refractiveindex.info, with DATA and in it "
                      "`type: tabulated nk` or the like, or the CSV columns wavelength_um,n,k")
        pieces: dict = {"n": [], "k": []}
        for block in blocks:
            kind = self._text(block, "type")
            line = source.position(block.place.begin)[0]
            if kind in _TABLES:
                for name, table in self._tabulated(source, block, _TABLES[kind]).items():
                    pieces[name].append((line, table))
            elif (match := re.fullmatch(r"formula (\d)", kind)) and int(match[1]) in fewest:
                number = int(match[1])
                pieces["n"].append((line, self._formula(block, line, number, fewest[number], most[number])))
            elif kind != "tabulated n2":  # the nonlinear index is beside it
                self.report(line, f"found the type {show(kind)}", f"expected {', '.join(_TABLES)}, or formula 1 to {max(fewest)}")
        for name, several in pieces.items():
            if len(several) > 1:
                self.report(several[1][0], f"found {name} a second time (first in line {several[0][0]})", "expected it once")
        if not pieces["n"]:
            self.report(None, "found no n", "expected a block `tabulated nk`, `tabulated n` or `formula 1` to `9` in DATA")
        if self.problems:
            raise BadTable(self.problems)
        return Constants(pieces["n"][0][1], pieces["k"][0][1] if pieces["k"] else None, _in_air(root))

    def _text(self, block: Mapping, name: str) -> str:
        node = block.get(name)
        return " ".join(node.text.split()) if isinstance(node, Scalar) else ""

    def _numbers(self, block: Mapping, name: str, line: int) -> list[float]:
        """The numbers behind a key, with blanks between them."""
        words = self._text(block, name).split()
        values = [finite_number(word) for word in words]
        if not words or None in values:
            wrong = f"found {show(words[values.index(None)])} in {name}" if words else f"found no {name}"
            self.stop(line, wrong, "expected numbers with blanks between them")
        return values

    def _formula(self, block: Mapping, line: int, number: int, fewest: int, most: int) -> Formula:
        named = "range" if "range" in block and "wavelength_range" not in block else "wavelength_range"
        span, coefficients = self._numbers(block, named, line), self._numbers(block, "coefficients", line)
        if len(span) != 2 or not 0 < span[0] < span[1]:
            self.stop(line, f"found the wavelength_range {' '.join(f'{value:g}' for value in span)}",
                      "expected two ascending wavelengths in um")
        if not fewest <= len(coefficients) <= most:
            self.stop(line, f"found {len(coefficients)} coefficients of formula {number}", f"expected {fewest} to {most}")
        return Formula(number, tuple(coefficients), (span[0], span[1]))

    def _tabulated(self, source: Source, block: Mapping, names: tuple[str, ...]) -> dict[str, Tabulated]:
        node = block.get("data")
        if not isinstance(node, Scalar):
            self.stop(source.position(block.place.begin)[0], "found no data", "expected rows of numbers behind `data: |`")
        first = source.position(node.place.begin)[0] + (source.text[node.place.begin:node.place.begin + 1] in ("|", ">"))
        return self._rows(node.text.split("\n"), first, ("wavelength", *names))

    # ---- ARIA

    def aria(self, data: bytes) -> Constants:
        lines = re.split(r"\r\n|\r|\n", data.decode("cp1252", "replace"))
        form, expected = None, "expected a line such as #FORMAT=WAVL N K"
        for number, line in enumerate(lines, 1):
            head = line.strip()
            if head.startswith("#") and head.lstrip("# \t").partition("=")[0].strip().upper() == "FORMAT":
                if form is not None:
                    self.stop(number, "found #FORMAT a second time", "expected it once")
                form = (number, head.partition("=")[2].replace(",", " ").upper().split())
        if form is None:
            self.stop(None, "found no #FORMAT", expected)
        number, names = form
        scale = [name for name in names if name in ("WAVL", "WAVN")]
        if len(scale) != 1 or names.count("N") != 1 or names.count("K") > 1:
            self.stop(number, f"found #FORMAT={show(' '.join(names))[1:-1]}",
                      "expected WAVL (um) or WAVN (1/cm), N and, optionally, K")
        columns = tuple({"WAVL": "wavelength", "WAVN": "wavenumber", "N": "n", "K": "k"}.get(name, "") for name in names)
        text = ["" if line.lstrip().startswith("#") else line for line in lines]
        tables = self._rows(text, 1, columns)
        return Constants(tables["n"], tables.get("k"))

    # ---- rows of both

    def _rows(self, lines: list[str], first: int, columns: tuple[str, ...]) -> dict[str, Tabulated]:
        """Tables of n and k: (name -> wavelengths and values).  What is no number (nan) is left out of its own table alone."""
        rows, at = [], []
        for number, line in enumerate(lines, first):
            words = line.replace(",", " ").split()
            if not words:
                continue
            if len(words) != len(columns):
                self.report(number, f"found {len(words)} number{'s' * (len(words) != 1)}", f"expected {len(columns)}")
                continue
            values = [finite_number(word) if word.lower() != "nan" else np.nan for word in words]
            if None in values:
                self.report(number, f"found {show(words[values.index(None)])}", "expected numbers")
                continue
            rows.append(values)
            at.append(number)
            if len(rows) > MAX_ROWS:
                self.stop(number, f"found more than {MAX_ROWS:,} rows", "expected a smaller table")
        if self.problems:
            raise BadTable(self.problems)
        if not rows:
            self.stop(None, "found no row of numbers", f"expected {' '.join(filter(None, columns))} in each")
        table, at = np.array(rows, float).T, np.array(at)
        scale = next(i for i, name in enumerate(columns) if name in ("wavelength", "wavenumber"))
        wrong = ~(table[scale] > 0)
        if wrong.any():
            self.stop(int(at[wrong][0]), f"found the {columns[scale]} {table[scale][wrong][0]:g}", "expected a value above 0")
        wavelength = 1e4 / table[scale] if columns[scale] == "wavenumber" else table[scale]
        return {name: self._sorted(wavelength, table[i], at, name) for i, name in enumerate(columns) if name in ("n", "k")}

    def _sorted(self, wavelength, values, at, name: str) -> Tabulated:
        order = np.argsort(wavelength, kind="stable")
        order = order[np.isfinite(values[order])]
        if not order.size:
            self.stop(None, f"found no number for {name}", "expected one or more")
        wavelength, values, at = wavelength[order], values[order], at[order]
        starts = np.flatnonzero(np.diff(wavelength, prepend=-1) > 0)
        low, high = np.minimum.reduceat(values, starts), np.maximum.reduceat(values, starts)
        apart = np.flatnonzero(high - low > _SEAM * np.abs(high))
        if apart.size:
            i, first = apart[0], starts[apart[0]]
            self.stop(int(at[first:first + 2].max()), f"found {name} {low[i]:g} and {high[i]:g} at {wavelength[first]:g} um",
                      "expected one value a wavelength")
        return Tabulated(wavelength[starts], (low + high) / 2)


def _in_air(root: Mapping) -> bool | None:
    """Whether a file says that n is relative to air."""
    for name in ("SPECS", "CONDITIONS"):
        specs = root.get(name)
        for word in _SAID if isinstance(specs, Mapping) else ():
            if isinstance(specs.get(word), Scalar):
                return specs[word].text.strip().lower() == "false"
    comments = root.get("COMMENTS")
    return True if isinstance(comments, Scalar) and _IN_AIR.search(comments.text) else None
