"""Mixtures of materials, and what humidity makes of particles, against equations, limits and published values."""

import numpy as np
import pytest

import bakery
from bakery.grammar.section import RULES as IN_RECIPES
from bakery.physics.materials.humidity import growth_factor, tabulated
from bakery.physics.materials.mixing import RULES, mixed
from bakery.physics.sizes import moved, population
from tests.physics.test_sizes import size

SOOT, WATER, DUST = 1.95 + 0.79j, 1.333 + 2e-9j, 1.53 + 0.008j


def one(rule, index, share, matrix=None):
    return complex(mixed(rule, [[m] for m in index], share, None if matrix is None else [matrix])[0])


def test_recipes_know_the_rules():
    assert RULES == IN_RECIPES


@pytest.mark.parametrize("rule", RULES)
def test_a_mixture_of_one_material_is_that_material(rule):
    matrix = DUST if rule == "maxwell_garnett" else None
    assert one(rule, [DUST, DUST], [0.3, 0.3 if matrix else 0.7], matrix) == pytest.approx(DUST, rel=1e-14)


@pytest.mark.parametrize("rule", RULES)
def test_a_trace_changes_nothing(rule):
    values = one(rule, [SOOT], [1e-12], WATER) if rule == "maxwell_garnett" else one(rule, [SOOT, WATER], [1e-12, 1 - 1e-12])
    assert values == pytest.approx(WATER, abs=1e-11)


@pytest.mark.parametrize("share", [0.01, 0.2, 0.333, 0.5, 0.9])
@pytest.mark.parametrize("index", [(SOOT, WATER), (0.055 + 3.42j, 1.5), (1.5, 1.33), (DUST, SOOT)])
def test_bruggeman_of_two_is_the_root_of_its_polynomial(index, share):
    """Roots by `numpy.roots` of the equation times its denominators; one is in the upper half plane, or positive."""
    a, b = (np.asarray(m, complex) ** 2 for m in index)
    f = share
    roots = np.sqrt(np.roots([-2, f * (2 * a - b) + (1 - f) * (2 * b - a), a * b]).astype(complex))
    there = max((root if root.real > 0 else -root for root in roots), key=lambda n: (round(n.imag, 12), n.real))
    assert one("bruggeman", index, [share, 1 - share]) == pytest.approx(there, rel=1e-10)


def test_bruggeman_of_three_solves_its_equation_and_reduces_to_two():
    share = np.array([0.2, 0.5, 0.3])
    e = np.array([SOOT, WATER, DUST]) ** 2
    mean = one("bruggeman", [SOOT, WATER, DUST], share) ** 2
    assert abs(np.sum(share * (e - mean) / (e + 2 * mean))) < 1e-12 and mean.imag > 0
    split = one("bruggeman", [SOOT, WATER, WATER], [0.2, 0.5, 0.3])
    assert split == pytest.approx(one("bruggeman", [SOOT, WATER], [0.2, 0.8]), rel=1e-12)


def test_maxwell_garnett_is_the_textbooks():
    """Bohren & Huffman 1983, eq. 8.50: e = e_m [1 + 3 f q/(1 - f q)], q = (e - e_m)/(e + 2 e_m)."""
    e, m, f = SOOT**2, WATER**2, 0.15
    q = (e - m) / (e + 2 * m)
    assert one("maxwell_garnett", [SOOT], [f], WATER) == pytest.approx(np.sqrt(m * (1 + 3 * f * q / (1 - f * q))), rel=1e-14)
    assert one("lorentz_lorenz", [SOOT], [1.0]) == pytest.approx(SOOT, rel=1e-14)
    vacuum = one("maxwell_garnett", [SOOT, DUST], [0.1, 0.2], 1.0)
    assert one("lorentz_lorenz", [SOOT, DUST, 1.0], [0.1, 0.2, 0.7]) == pytest.approx(vacuum, rel=1e-14)


# mg_refractive and bruggeman_refractive of pytmatrix (J. Leinonen): soot in water, air in ice, ice in water at 95 GHz
PYTMATRIX = [
    (WATER, SOOT, 0.15, 1.43667550684944 + 0.0925297131635418j, 1.43224454654844 + 0.0982310620371591j),
    (1.31 + 1e-8j, 1.0, 0.6, 1.12299878459101 + 3.99927539458957e-09j, 1.12035888876045 + 3.77244599521666e-09j),
    (3.382 + 1.941j, 1.78 + 0.0024j, 0.4, 2.69830624198522 + 1.23297851454704j, 2.70695895848506 + 1.10781283135971j)]


@pytest.mark.parametrize(("matrix", "inclusion", "share", "garnett", "bruggeman"), PYTMATRIX)
def test_mixtures_are_those_of_pytmatrix(matrix, inclusion, share, garnett, bruggeman):
    assert one("maxwell_garnett", [inclusion], [share], matrix) == pytest.approx(garnett, rel=1e-13)
    assert one("bruggeman", [inclusion, matrix], [share, 1 - share]) == pytest.approx(bruggeman, rel=1e-13)


def test_small_inclusions_agree_to_first_order():
    """At a share f both rules have the same term in f; they differ in f^2."""
    for f in (1e-3, 1e-4):
        gap = abs(one("bruggeman", [SOOT, WATER], [f, 1 - f]) - one("maxwell_garnett", [SOOT], [f], WATER))
        assert gap < 5 * f * f


def test_clear_materials_stay_clear():
    for rule in ("bruggeman", "lorentz_lorenz", "volume"):
        assert one(rule, [1.5, 1.33], [0.4, 0.6]).imag == 0


def test_five_hundred_wavelengths_at_once():
    index = np.array([np.linspace(1.5, 2.0, 500) + 0.5j, np.full(500, 1.33 + 0j)])
    for rule in ("bruggeman", "lorentz_lorenz", "volume"):
        every = mixed(rule, index, [0.3, 0.7])
        assert every[77] == pytest.approx(one(rule, index[:, 77], [0.3, 0.7]), rel=1e-14)


def test_a_resonance_has_no_index():
    with pytest.raises(ValueError, match="another rule"):
        one("maxwell_garnett", [2j], [0.4], 1.0)  # a metal without losses, of permittivity -4: 0.4 (-5/-2) = 1


# ---- humidity


def test_kappa_koehler():
    assert growth_factor(0.61, 0.0) == 1 and growth_factor(0.0, 0.99) == 1
    # as much water as particle where kappa a = 1 - a
    assert growth_factor(1.0, 0.5) == pytest.approx(2 ** (1 / 3), rel=1e-14)
    assert growth_factor(0.61, 0.9) == pytest.approx((1 + 0.61 * 9) ** (1 / 3), rel=1e-14)


@pytest.mark.parametrize("radius, less", [(100, 0.016), (50, 0.030), (20, 0.071)])
def test_what_curvature_would_change_is_as_the_page_says(radius, less):
    """Petters & Kreidenweis 2007, eq. 6: humidity = activity exp(A/D), A = 2.1 nm at 298 K, solved for the growth factor."""
    from scipy.optimize import brentq

    def residual(g):
        activity = 0.9 / np.exp(2.1 / (2 * radius * g))
        return g**3 - 1 - 0.6 * activity / (1 - activity)

    assert 1 - brentq(residual, 1.0, 3.0) / growth_factor(0.6, 0.9) == pytest.approx(less, abs=6e-4)


# Hess, Koepke & Schult, Bull. Am. Meteorol. Soc. 79, 831 (1998), table 1c and the data files of OPAC: mode radii in um
OPAC_RH = (0.0, 0.5, 0.7, 0.8, 0.9, 0.95, 0.98, 0.99)
WASO = (0.0212, 0.0262, 0.0285, 0.0306, 0.0348, 0.0399, 0.0476, 0.0534)


def test_a_table_is_hit_and_rises_between_its_rows():
    factor = np.array(WASO) / WASO[0]
    for h, g in zip(OPAC_RH, factor):
        assert tabulated(OPAC_RH, factor, h) == pytest.approx(g, rel=1e-14)
    every = [tabulated(OPAC_RH, factor, h) for h in np.linspace(0, 0.99, 400)]
    assert (np.diff(every) > 0).all()
    with pytest.raises(ValueError, match="is above the table; 0 to"):
        tabulated(OPAC_RH, factor, 0.995)


def test_a_table_of_one_kappa_is_that_kappa():
    h = np.array([0.3, 0.8, 0.95])
    factor = [growth_factor(0.4, x) for x in h]
    for x in (0.0, 0.1, 0.5, 0.9):
        assert tabulated(h, factor, x) == pytest.approx(growth_factor(0.4, x), rel=1e-14)


# Data files waso80, waso95, suso90 and ssam80 of OPAC 3.1 at 0.55 um: dry radius in um, sigma, dry index; extinction in 1/km of
# a particle in a cm^3, albedo, asymmetry
OPAC = {("waso", 80): (0.0212, 2.24, "{n: 1.53, k: 0.006}", 9.584e-6, 0.9843, 0.704),
        ("waso", 95): (0.0212, 2.24, "{n: 1.53, k: 0.006}", 2.038e-5, 0.9925, 0.743),
        ("suso", 90): (0.0695, 2.03, "{n: 1.43, k: 1e-8}", 3.652e-4, 1.0, 0.790),
        ("ssam", 80): (0.209, 2.03, "{n: 1.50, k: 1e-8}", 3.743e-3, 1.0, 0.784)}


@pytest.mark.parametrize(("name", "humidity"), OPAC)
def test_particles_that_grow_by_opacs_tables_are_those_of_opac(name, humidity):
    """From the dry particles alone: within 1 %, the tolerance; digits of OPAC are 3 of the radius, to the sixth power in waso."""
    radius, sigma, index, extinction, albedo, g = OPAC[name, humidity]
    medium = bakery.bake(f"""\
bakery: 1
name: wet
measure: integrated
wavelengths: [0.55]
particles:
  number_density: 1 /cm^3
  relative_humidity: {humidity}%
  components:
    - name: particles
      material: {index}
      size: {{distribution: lognormal, radius: {radius} um, sigma: {sigma}, max: 20 um}}
      growth: {{file: growth/opac_{name}.csv}}
""").medium
    assert 1000 * medium.sigma_t[0] == pytest.approx(extinction, rel=0.01)
    assert medium.albedo[0] == pytest.approx(albedo, abs=1e-4) and medium.g[0] == pytest.approx(g, abs=1e-3)


# ---- radii that have grown


@pytest.mark.parametrize("s", [size("lognormal", radius=0.5, sigma=1.5, min=0.2, max=2.0), size("single", radius=0.3),
                               size("junge", exponent=3.0, min=0.1, max=2.0), size("gamma", radius=1.0, variance=0.1),
                               size("histogram", file=((0.1, 0.2, 0.5), (3.0, 1.0), 0.0))])
def test_moments_of_grown_radii(s):
    dry = population(s)
    wet, coated = moved(dry, 1.7), moved(dry, 1.0, 0.05)
    for power in (0, 1, 2, 3, 4):
        assert wet.moment(power) == pytest.approx(1.7**power * dry.moment(power), rel=1e-12)
    assert coated.moment(1) == pytest.approx(dry.moment(1) + 0.05, rel=1e-12)
    assert coated.moment(3) == pytest.approx(dry.moment(3) + 0.15 * dry.moment(2) + 0.0075 * dry.moment(1) + 0.05**3, rel=1e-12)
    if not dry.single:
        from bakery.physics.sizes import Nodes

        radius, weight = Nodes(coated, np.array([10.0]), 0.01).whole(4)
        assert np.sum(weight * radius**3) == pytest.approx(coated.moment(3), rel=2e-3) and radius.min() >= 0.05
    assert moved(dry, 1.0) is dry
