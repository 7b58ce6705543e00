"""Optical properties from OPAC's own text: one component at one humidity, of one particle in a cm^3 (Hess, Koepke & Schult 1998).

A table "optical parameters" (wavelength in um, extinction, scattering, absorption in 1/km, and more), all of its lines commented
out, and a table "volume phase function" (1/km) of scattering angles by the same wavelengths.  Numbers stand in fixed columns,
sometimes without a space before a minus.
"""

import re

import numpy as np

from bakery.grammar.text import show
from bakery.grammar.units import Wrong

_NUMBER = re.compile(r"[-+]?\d+\.\d*(?:[EeDd][-+]\d+)?")
_PARAMETERS, _PHASE = "optical parameters", "phase function"
_COLUMNS = 6  # of the first table that count: wavelength, extinction, scattering, absorption, albedo, mean cosine
_AREA = 1e-9  # 1/km of one particle in a cm^3, in m^2
_SAME = 1e-6  # relative, of two wavelengths
_DIGITS = 2e-3  # of the file: extinction and its parts have four


def is_opac(data: bytes) -> bool:
    """Whether a file begins with the comments of such a text."""
    head = data[:2048]
    return head.startswith(b"#") and _PARAMETERS.encode() in head and b"ext.coef" in head


def read(data: bytes) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Wavelength (W,) um, extinction of a particle (W,) m^2, albedo (W,), angles (A,) rad, phase functions (W, A) 1/sr.

    Raises `Wrong`.
    """
    lines = data.decode("latin-1").splitlines()
    first, second = (_after(lines, words) for words in (_PARAMETERS, _PHASE))
    if not any("[1/km]" in line for line in lines[first:second]) or "[1/km]" not in lines[second - 1]:
        raise Wrong("found no unit 1/km", "expected coefficients and phase function in 1/km, as OPAC writes them")
    table = _rows([line for line in lines[first:second] if line.startswith("#")], "optical parameters", _COLUMNS)
    heads = [line for line in lines[second:] if line.startswith("#") and _NUMBER.search(line)]
    if len(heads) != 1:
        raise Wrong(f"found {len(heads)} lines with the wavelengths of the phase functions", "expected 1")
    columns = _numbers(heads[0])
    rows = _rows([line for line in lines[second:] if not line.startswith("#")], "phase functions", columns.size + 1)
    if rows.shape[1] != columns.size + 1:
        raise Wrong(f"found phase functions in lines of {rows.shape[1]} numbers", f"expected an angle and {columns.size}")
    wavelength = table[:, 0]
    if columns.size != wavelength.size or not np.allclose(columns, wavelength, rtol=_SAME, atol=0):
        raise Wrong(f"found {columns.size} wavelengths of phase functions, {wavelength.size} of coefficients",
                    "expected the same of both")
    albedo = _albedo(*table[:, 1:4].T)
    scattering = albedo * table[:, 1]
    phase = np.divide(rows[:, 1:].T, scattering[:, None], out=np.zeros(rows[:, 1:].T.shape), where=scattering[:, None] > 0)
    return wavelength, _AREA * table[:, 1], albedo, np.radians(rows[:, 0]), phase


def _after(lines: list[str], words: str) -> int:
    """Of the line after a title."""
    for i, line in enumerate(lines):
        if line.startswith("#") and words in line:
            return i + 1
    raise Wrong(f"found no title {show(words)}", "expected the text of an OPAC component (optdat)")


def _numbers(line: str) -> np.ndarray:
    return np.array([float(word.replace("D", "E").replace("d", "e")) for word in _NUMBER.findall(line)])


def _rows(lines: list[str], words: str, least: int) -> np.ndarray:
    """The numbers of lines that hold some, as many in each."""
    rows = [row for row in map(_numbers, lines) if row.size]
    if not rows or len({row.size for row in rows}) > 1 or rows[0].size < least:
        sizes = sorted({row.size for row in rows})
        raise Wrong(f"found {words} in {len(rows)} lines of {' or '.join(map(str, sizes)) or 'no'} numbers",
                    f"expected lines of {least} or more, as many in each")
    return np.stack(rows)


def _albedo(extinction, scattering, absorption) -> np.ndarray:
    """Of whichever part is the smaller: it has the more digits."""
    if not (np.abs(scattering + absorption - extinction) <= _DIGITS * np.abs(extinction)).all():
        raise Wrong("found an extinction that is not scattering and absorption", "expected their sum, to the digits of the file")
    part = np.divide(np.minimum(scattering, absorption), extinction, out=np.zeros_like(extinction), where=extinction > 0)
    return np.clip(np.where(scattering < absorption, part, 1 - part), 0.0, 1.0)
