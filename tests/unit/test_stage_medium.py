"""The two stages that fill `medium`: from particles and from coefficients."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from bakery.errors import StageError
from bakery.stages.conform import broken
from bakery.stages.medium.stage import OF_COEFFICIENTS, OF_PARTICLES
from bakery.stages.optics import stage as optics
from bakery.store.tree import Dataset, Group
from tests.unit.test_stage_optics import Here, recipe, tamper


@pytest.fixture(scope="module")
def upstream():
    result = optics.STAGE.compute(optics.STAGE.inputs(recipe(polarized=True), {}), Here())
    return {"optics": Group(result.members)}


def of_particles(upstream, **given):
    return OF_PARTICLES.compute(OF_PARTICLES.inputs(recipe(polarized=True, **given), upstream), Here())


def of_coefficients(tolerance=0.01, albedo=(0.9, 1.0), **kind):
    phase = dict(type="hg", g=np.array([0.7, -0.2])) | kind
    medium = SimpleNamespace(mean_free_path=1e6 / np.array([2.0, 5.0]), albedo=np.array(albedo), phase=SimpleNamespace(**phase))
    made = SimpleNamespace(wavelength=(0.6, 0.5), medium=medium, particles=None, tolerance=tolerance)
    return OF_COEFFICIENTS.compute(OF_COEFFICIENTS.inputs(made, {}), Here(tolerance)), made


def test_coefficients_are_numbers_times_cross_sections(upstream):
    result, drops, dust = of_particles(upstream), upstream["optics"]["drops"], upstream["optics"]["dust"]
    for name, mean in (("sigma_s", "mean_scattering"), ("sigma_a", "mean_absorption"), ("sigma_t", "mean_extinction")):
        expected = 1e8 * 1e-12 * (0.8 * drops[mean].data + 0.2 * dust[mean].data)
        assert result.members[name].data == pytest.approx(expected, rel=1e-12)
    assert result.members["s11"].data.tobytes() == result.members["phase"].data.tobytes()


def test_volume_fraction_and_number_density_say_the_same(upstream):
    volume = 0.8 * upstream["optics"]["drops/mean_volume"].data[0] + 0.2 * upstream["optics"]["dust/mean_volume"].data[0]
    by_volume = of_particles(upstream, number=None, filled=1e8 * volume * 1e-18)
    assert by_volume.members["sigma_t"].data == pytest.approx(of_particles(upstream).members["sigma_t"].data, rel=1e-12)
    # the drops' mean volume is the closed form of the log-normal law
    assert upstream["optics"]["drops/mean_volume"].data[0] == pytest.approx(
        4 / 3 * math.pi * 0.125 * math.exp(4.5 * math.log(1.5) ** 2), rel=1e-12)


def test_absorbing_host_adds_its_bulk_absorption(upstream):
    plain, wet = of_particles(upstream), of_particles(upstream, host_k=1e-6)
    extra = wet.members["sigma_a"].data - plain.members["sigma_a"].data
    assert extra == pytest.approx(4 * math.pi * 1e-6 / (np.array([0.6, 0.45]) * 1e-6), rel=1e-6)
    assert any("host absorbs" in note for note in wet.notes) and list(OF_PARTICLES.check(Group(wet.members))) == []


def test_too_many_particles_are_refused_or_noted(upstream):
    with pytest.raises(StageError, match="smaller number_density"):
        of_particles(upstream, number=1e19)
    assert any("independently" in note for note in of_particles(upstream, number=None, filled=0.1).notes)


TAMPERED = [
    ("phase", lambda a: a * 1.0001, "integrates"),
    ("sigma_s", lambda a: a * 1.01, "sigma_t is not"),
    ("albedo", lambda a: a * 1.2, "albedo"),
    ("g", lambda a: a +1e-6, "mean cosine"),
    ("cdf", lambda a: a ** 1.01, "integral of phase"),
    ("cdf", lambda a: a[:,:: -1], "rise"),
    ("theta", lambda a: a * 1.01, "above 3.14"),
    ("sigma_tr", lambda a: a * 1.01, "sigma_tr"),
    ("s11", lambda a: a * 1.01, "s11"),
    ("s33", lambda a: a * 2 +1, "exceeds"),
    ("sigma_a", lambda a: a * np.inf, "finite"),
    ("sigma_t", lambda a: -a, "below 0"),
    ("phase", lambda a: np.roll(a, 1, axis=1), "mean cosine"),
    ("sigma_t_reduced", lambda a: a * 0.99, "sigma_t_reduced"),]


@pytest.mark.parametrize("path, change, words", TAMPERED)
def test_tampered_values_are_found(upstream, path, change, words):
    faults = broken(OF_PARTICLES, tamper(Group(of_particles(upstream).members), path, change))
    assert any(words in fault for fault in faults), faults


def test_given_coefficients_are_kept():
    result, _ = of_coefficients()
    values = {name: member.data for name, member in result.members.items() if isinstance(member, Dataset)}
    assert (values["sigma_t"] == [2.0, 5.0]).all() and (values["albedo"] == [0.9, 1.0]).all()
    assert values["sigma_a"][1] == 0 and values["sigma_tr"][1] == 0 and values["albedo_reduced"][1] == 1
    assert values["g"] == pytest.approx([0.7, -0.2], abs=2e-3)
    assert result.achieved_error <= 0.002
    reduced = (1 - values["g"]) * values["sigma_s"] + values["sigma_a"]
    assert values["sigma_t_reduced"] == pytest.approx(reduced, rel=1e-13)


@pytest.mark.parametrize("kind",
                         [dict(type="isotropic", g=None),
                          dict(type="rayleigh", g=None),
                          dict(type="gaussian", g=None, spread=0.5),
                          dict(g=np.array([0.9999, -0.9999])),
                          dict(g=np.array([0.0, 0.0])),
                          dict(type="table", g=None, file=(np.array([0.0, 1.0, math.pi]), np.array([3.0, 1.0, 0.0])))])
def test_every_kind_of_phase_function_passes_its_rules(kind):
    result, made = of_coefficients(**kind)
    assert list(OF_COEFFICIENTS.check(Group(result.members))) == []
    assert OF_COEFFICIENTS.cost(made).file < 1e6


def test_impossible_phase_functions_are_stage_errors():
    with pytest.raises(StageError, match="-1 < g < 1"):
        of_coefficients(g=np.array([1.0, 0.0]))


def test_what_each_reads():
    from bakery.plan.inputs import reads_key

    components = "particles.components[0]."
    yes = ("particles.number_density", "particles.volume_fraction", f"{components}fraction")
    no = (f"{components}size.sigma", "description", "phase.polarized", "name")
    assert all(reads_key(OF_PARTICLES, key) for key in yes) and not any(reads_key(OF_PARTICLES, key) for key in no)
    assert reads_key(OF_COEFFICIENTS, "medium.phase.g[0]") and not reads_key(OF_COEFFICIENTS, "name")
    assert OF_PARTICLES.name == OF_COEFFICIENTS.name == "medium" and OF_PARTICLES.needs == ("optics",)


def test_the_medium_of_several_components_meets_the_tolerance(upstream):
    """Each component leaves room for the error of the weights."""
    error = max(float(upstream["optics"][f"{name}/error"].data.max()) for name in ("drops", "dust"))
    assert error <= 0.03 / (1 + optics.WEIGHTS)
    assert error < of_particles(upstream).achieved_error <= 0.03
