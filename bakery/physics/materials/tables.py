"""Dispersion formulas, and the tables of `assets/materials` that are made from them.

    python -m bakery.physics.materials.tables      writes water, air, bk7, silica and nacl in assets/materials again

Formulas for glass and salt are measured in air: the tables hold n relative to vacuum at vacuum wavelengths, converted with the
index of standard air.  Tables of measured n (ice, dust, soot) are their own source and are not made here.
"""

import math
from pathlib import Path

# Hale & Querry, Appl. Opt. 12, 555 (1973), water at 25 C: wavelength in um, k
WATER_K = (
    (0.200, 1.10e-7), (0.225, 4.90e-8), (0.250, 3.35e-8), (0.275, 2.35e-8), (0.300, 1.60e-8), (0.325, 1.08e-8), (0.350, 6.50e-9),
    (0.375, 3.50e-9), (0.400, 1.86e-9), (0.425, 1.30e-9), (0.450, 1.02e-9), (0.475, 9.35e-10), (0.500, 1.00e-9), (0.525, 1.32e-9),
    (0.550, 1.96e-9), (0.575, 3.60e-9), (0.600, 1.09e-8), (0.625, 1.39e-8), (0.650, 1.64e-8), (0.675, 2.23e-8), (0.700, 3.35e-8),
    (0.725, 9.15e-8), (0.750, 1.56e-7), (0.775, 1.48e-7), (0.800, 1.25e-7), (0.825, 1.82e-7), (0.850, 2.93e-7), (0.875, 3.91e-7),
    (0.900, 4.86e-7), (0.925, 1.06e-6), (0.950, 2.93e-6), (0.975, 3.48e-6), (1.000, 2.89e-6), (1.200, 9.89e-6))
# Schott catalogue 2017-01-20, N-BK7, from internal transmittance: wavelength in um, k
BK7_K = (
    (0.300, 2.8607e-6), (0.310, 1.3679e-6), (0.320, 6.6608e-7), (0.334, 2.6415e-7), (0.350, 9.2894e-8), (0.365, 3.4191e-8),
    (0.370, 2.7405e-8), (0.380, 2.0740e-8), (0.390, 1.3731e-8), (0.400, 1.0227e-8), (0.405, 9.0558e-9), (0.420, 9.3912e-9),
    (0.436, 1.1147e-8), (0.460, 1.0286e-8), (0.500, 9.5781e-9), (0.546, 6.9658e-9), (0.580, 9.2541e-9), (0.620, 1.1877e-8),
    (0.660, 1.2643e-8), (0.700, 8.9305e-9), (1.060, 1.0137e-8), (1.530, 9.8390e-8), (1.970, 1.0933e-6), (2.325, 4.2911e-6),
    (2.500, 8.1300e-6))


def _sellmeier(wavelength: float, terms, constant: float = 1.0) -> float:
    """n = sqrt(constant + sum B l^2/(l^2 - C)), l in um."""
    square = wavelength * wavelength
    return math.sqrt(constant + math.fsum(b * square / (square - c) for b, c in terms))


def water(wavelength: float) -> float:
    """n of water at 20 C relative to vacuum, 0.182 to 1.129 um.  Daimon & Masumura, Appl. Opt. 46, 3811 (2007)."""
    return _sellmeier(wavelength, ((0.5684027565, 0.005101829712), (0.1726177391, 0.01821153936), (0.02086189578, 0.02620722293),
                                   (0.1130748688, 10.69792721)))


def air(wavelength: float) -> float:
    """n of dry air at 15 C, 101325 Pa, 450 ppm CO2, 0.23 to 1.69 um in vacuum.  Ciddor, Appl. Opt. 35, 1566 (1996)."""
    inverse = wavelength**-2
    return 1 + 0.05792105 / (238.0185 - inverse) + 0.00167917 / (57.362 - inverse)


def bk7(wavelength: float) -> float:
    """n of N-BK7 relative to air, 0.3 to 2.5 um in air.  Schott catalogue."""
    return _sellmeier(wavelength, ((1.03961212, 0.00600069867), (0.231792344, 0.0200179144), (1.01046945, 103.560653)))


def silica(wavelength: float) -> float:
    """n of fused silica at 20 C relative to air, 0.21 to 3.71 um in air.  Malitson, J. Opt. Soc. Am. 55, 1205 (1965)."""
    return _sellmeier(wavelength, ((0.6961663, 0.0684043**2), (0.4079426, 0.1162414**2), (0.8974794, 9.896161**2)))


def nacl(wavelength: float) -> float:
    """n of rock salt at 20 C relative to air, 0.2 to 30 um in air.  Li, J. Phys. Chem. Ref. Data 5, 329 (1976)."""
    terms = ((0.19800, 0.050), (0.48398, 0.100), (0.38696, 0.128), (0.25998, 0.158), (0.08796, 40.50), (3.17064, 60.98),
             (0.30038, 120.34))
    return _sellmeier(wavelength, [(b, c * c) for b, c in terms], 1.00055)


def in_vacuum(formula, wavelength: float) -> float:
    """n relative to vacuum, at a vacuum wavelength, from a formula for both in air."""
    n = air(min(max(wavelength, 0.23), 1.69))  # beyond Ciddor's range n - 1 changes by less than 4e-5 (0.2 um) and 1e-7 (2.5 um)
    return n * formula(wavelength / n)


def _log_interpolate(table, wavelength: float) -> float:
    for (w0, k0), (w1, k1) in zip(table, table[1:]):
        if w0 <= wavelength <= w1:
            return k0 * (k1 / k0) ** ((wavelength - w0) / (w1 - w0))
    raise ValueError(f"wavelength {wavelength} um is outside the table; {table[0][0]:g} to {table[-1][0]:g} um would do")


_CLEAR = "k is set to 0: absorption in the range is far below what a small particle shows"
_FACTS = "facts, evaluated from the published formula"

# name: (header, from and to in nm, n, k)
TABLES = {
    "water": (("substance: liquid water, n at 20 C, k at 25 C",
               "source: n Daimon & Masumura, Appl. Opt. 46, 3811 (2007); k Hale & Querry, Appl. Opt. 12, 555 (1973)",
               f"licence: {_FACTS} and table", "temperature: 20 C (n), 25 C (k)",
               "note: k between Hale & Querry's rows (every 25 nm, and 1.0 and 1.2 um) is interpolated in ln k"),
              (200, 1125), water, lambda w: _log_interpolate(WATER_K, w)),
    "air": (("substance: dry air, 101325 Pa, 450 ppm CO2", "source: Ciddor, Appl. Opt. 35, 1566 (1996)", f"licence: {_FACTS}",
             "temperature: 15 C", f"note: {_CLEAR}"), (230, 1675), air, lambda w: 0.0),
    "bk7": (("substance: optical glass Schott N-BK7", "source: Schott catalogue (Sellmeier formula; k from transmittance)",
             f"licence: {_FACTS} and data sheet", "temperature: 20 C",
             "note: the formula is relative to air; converted to vacuum with the index of standard air (Ciddor 1996)"),
            (300, 2500), lambda w: in_vacuum(bk7, w), lambda w: _log_interpolate(BK7_K, w)),
    "silica": (("substance: fused silica", "source: Malitson, J. Opt. Soc. Am. 55, 1205 (1965)", f"licence: {_FACTS}",
                "temperature: 20 C",
                f"note: the formula is relative to air; converted to vacuum (Ciddor 1996); {_CLEAR}"),
               (215, 2500), lambda w: in_vacuum(silica, w), lambda w: 0.0),
    "nacl": (("substance: rock salt, NaCl", "source: Li, J. Phys. Chem. Ref. Data 5, 329 (1976)", f"licence: {_FACTS}",
              "temperature: 20 C",
              f"note: the formula is relative to air; converted to vacuum (Ciddor 1996); {_CLEAR}"),
             (205, 2500), lambda w: in_vacuum(nacl, w), lambda w: 0.0),
}


def table(name: str) -> str:
    """The text of one table."""
    header, (low, high), n, k = TABLES[name]
    # steps of 5 nm, and of 25 nm above 1.2 um, where dispersion is weak
    grid = [nm / 1000 for nm in (*range(low, min(high, 1200) + 1, 5), *range(1225, high + 1, 25))]
    lines = [f"# name: {name}", *(f"# {line}" for line in header), "# relative_to: vacuum",
             f"# range: {grid[0]:g} to {grid[-1]:g} um", "# made by: python -m bakery.physics.materials.tables",
             "wavelength_um,n,k"]
    digits = 8 if name == "air" else 6
    lines += [f"{w:.3f},{n(w):.{digits}f},{k(w):.4g}" for w in grid]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    for made in TABLES:
        Path(__file__).parents[3].joinpath("assets", "materials", f"{made}.csv").write_text(table(made), encoding="utf-8")
