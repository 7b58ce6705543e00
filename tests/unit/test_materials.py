"""The tables that ship, against formulas, published checkpoints and each other."""

import math

import numpy as np
import pytest

from bakery.grammar import tables as csv
from bakery.grammar.files import asset_root, materials
from bakery.physics.materials import Table, index, tables

NAMES = {"air", "bk7", "copper", "dust", "ice", "nacl", "quartz", "silica", "soot", "vacuum", "water"}


def read(name: str) -> Table:
    return Table(*csv.read((asset_root() / "materials" / f"{name}.csv").read_bytes(), name, "", csv.INDEX))


def test_all_are_there():
    assert set(materials()) == NAMES


@pytest.mark.parametrize("name", sorted(NAMES))
def test_tables_say_what_they_are(name):
    text = (asset_root() / "materials" / f"{name}.csv").read_text(encoding="utf-8")
    header = dict(line[2:].split(": ", 1) for line in text.splitlines() if line.startswith("# ") and ": " in line)
    assert {"name", "source", "licence", "temperature", "relative_to", "range"} <= header.keys()
    assert header["name"] == name and header["relative_to"] == "vacuum"
    table = read(name)
    low, high = header["range"].removesuffix(" um").split(" to ")
    assert (table.wavelength[0], table.wavelength[-1]) == (float(low), float(high))
    assert table.wavelength[0] <= 0.405 and table.wavelength[-1] >= 0.755, "covers visible8"


@pytest.mark.parametrize("name", sorted(tables.TABLES))
def test_tables_are_what_the_formulas_give(name):
    assert (asset_root() / "materials" / f"{name}.csv").read_text(encoding="utf-8") == tables.table(name)


# Published values, independent of the code: Daimon & Masumura at 20 C, Warren & Brandt, Hale & Querry
@pytest.mark.parametrize("name, wavelength, n", [
    ("water", 0.4, 1.34356), ("water", 0.5, 1.33680), ("water", 0.6, 1.33302), ("water", 0.7, 1.33052),
    ("water", 0.5893, 1.33335),
    ("ice", 0.39, 1.3203), ("ice", 0.5, 1.3130), ("ice", 0.62, 1.3088), ("ice", 0.78, 1.3053),
    ("dust", 0.55, 1.53), ("soot", 0.55, 1.95), ("air", 0.55, 1.00028),
])
def test_n_at_checkpoints(name, wavelength, n):
    digits = 5 if name != "ice" else 4
    assert index(read(name), [wavelength])[0][0] == pytest.approx(n, abs=1.01 * 10**-digits)


@pytest.mark.parametrize("name, wavelength, n", [
    ("bk7", 0.4, 1.53085), ("bk7", 0.5, 1.52141), ("bk7", 0.5876, 1.51680), ("bk7", 0.7, 1.51306),
    ("silica", 0.4, 1.47012), ("silica", 0.5, 1.46233), ("silica", 0.5876, 1.45846), ("silica", 0.7, 1.45529),
    ("nacl", 0.4, 1.56746), ("nacl", 0.5, 1.55157), ("nacl", 0.5876, 1.54420), ("nacl", 0.7, 1.53865),
    ("quartz", 0.5893, (2 * 1.54424 + 1.55335) / 3),  # the handbooks' indices of the two rays in sodium light
])
def test_solids_relative_to_air(name, wavelength, n):
    """The published values are in air: the table's n at the vacuum wavelength, over the index of air."""
    air = 1.000277  # at 0.55 um; varies by 1e-5 over the visible
    found = index(read(name), [wavelength * air])[0][0] / air
    assert found == pytest.approx(n, abs=5e-5 if name == "quartz" else 3e-5)  # 1e-5 air, 1.2e-5 interpolation, 5e-6 last digit


@pytest.mark.parametrize("name, wavelength, k", [
    ("water", 0.4, 1.86e-9), ("water", 0.475, 9.35e-10), ("water", 0.6, 1.09e-8), ("water", 0.75, 1.56e-7),
    ("ice", 0.5, 5.889e-10), ("ice", 0.7, 2.900e-8), ("dust", 0.45, 0.0085), ("dust", 0.6, 0.0045), ("soot", 0.55, 0.79),
])
def test_k_at_checkpoints(name, wavelength, k):
    assert index(read(name), [wavelength])[1][0] == pytest.approx(k, rel=1e-3)


def test_water_agrees_with_the_older_measurement():
    """Hale & Querry's n (25 C, three decimals) is another experiment: within its rounding and 1e-3 for the temperature."""
    wavelength = [0.4, 0.45, 0.5, 0.55, 0.6, 0.65, 0.7]
    theirs = [1.339, 1.337, 1.335, 1.333, 1.332, 1.331, 1.331]
    # theirs scatters about a line that lies 2e-3 lower at most, the largest difference being at 0.4 um
    assert np.abs(index(read("water"), wavelength)[0] - theirs).max() < 5e-3


def test_air_is_ciddor():
    """Ciddor 1996, table 1: (n - 1) x 1e8 of standard air at 633 nm is 27651.7 (his 15 C, 101325 Pa, 450 ppm)."""
    assert (tables.air(0.633) - 1) * 1e8 == pytest.approx(27651.7, abs=2)


def test_copper_agrees_with_another_measurement():
    """n + ik at 632.8 nm as measured by others is 0.239 + 3.416i; Johnson & Christy give their own errors as 0.02 about."""
    n, k = index(read("copper"), [0.6328])
    assert n[0] == pytest.approx(0.239, abs=0.04) and k[0] == pytest.approx(3.416, abs=0.04)
    n, k = index(read("copper"), [0.465, 0.55, 0.61])
    blue, green, red = ((n - 1) ** 2 + k**2) / ((n + 1) ** 2 + k**2)
    assert blue < green < 0.75 * red < 0.75  # it is red


def test_linear_n_is_close_to_the_formula():
    for name, bound in {"water": 6e-6, "bk7": 6e-6, "silica": 6e-6, "nacl": 1.2e-5}.items():
        wavelength = np.linspace(0.35, 1.1, 3001)
        exact = np.array([tables.TABLES[name][2](w) for w in wavelength])
        assert np.abs(index(read(name), wavelength)[0] - exact).max() < bound


def test_interpolation():
    table = Table(np.array([0.4, 0.6, 0.8]), np.array([1.5, 1.4, 1.4]), np.array([1e-8, 1e-6, 0.0]))
    n, k = index(table, [0.4, 0.5, 0.6, 0.7, 0.8])
    assert n == pytest.approx([1.5, 1.45, 1.4, 1.4, 1.4], rel=1e-15)
    assert k == pytest.approx([1e-8, 1e-7, 1e-6, 5e-7, 0.0], rel=1e-12)
    assert k[0] == 1e-8 and k[2] == 1e-6  # the rows themselves to the last bit
    for outside in (0.3999, 0.8001, math.nan):
        with pytest.raises(ValueError, match="outside"):
            index(table, [0.5, outside])
