"""Rays instead of series: the measured error covers the true one, and rays are taken only where they should be."""

import math
from functools import cache

import numpy as np
import pytest

from bakery.physics.averages import Aim, Component, Rays, averages, expected
from bakery.physics.averages.choice import LOWEST, choose
from bakery.physics.averages.spheres import channels_of
from bakery.physics.medium import phase
from bakery.physics.sizes import population
from bakery.physics.tasks import in_turn
from tests.conftest import slow
from tests.physics.test_averages import size

TOLERANCE = 0.03


def bake(m, radius, sigma, rays, wavelength=0.6, map=in_turn, **options):
    component = Component("spheres", np.array([complex(m)]), population(size("lognormal", radius=radius, sigma=sigma)))
    theta, found = averages([component], [wavelength], [1.0], Aim(TOLERANCE, rays=rays, **options), map)
    return theta, found[0]


@cache
def by(method, m, radius, sigma=1.3):
    return bake(m, radius, sigma, Rays(method))


def difference(one, other):
    """Integral of |f - f_ref| over the sphere, both as tables on their own angles."""
    theta = np.union1d(one[0], other[0])
    f, g = (phase.phase_at(at, found.elements[0, 0], theta) for at, found in (one, other))
    return phase.phase_integral(theta, np.abs(f - g))


@pytest.mark.parametrize(("m", "radius"), [(1.33, 6.0), slow(1.33, 15.0), (1.5 + 1e-3j, 12.0), (0.75, 6.0), slow(1.31, 24.0)])
def test_measured_error_covers_the_true_one(m, radius):
    series, rays = by("mie", m, radius), by("goa", m, radius)
    choice = rays[1].choices[0]
    assert choice.switch == LOWEST
    # both tables carry quadrature and interpolation errors of their own, far below these in the integral
    true = difference(rays, series)
    assert true < 1.05 * choice.error + 0.002
    assert choice.error < 3 * true + 0.002
    assert np.array_equal(rays[1].scattering, series[1].scattering)
    # and at each angle the table of errors, nearly everywhere
    f, g = (phase.phase_at(at, found.elements[0, 0], series[0]) for at, found in (rays, series))
    claimed = np.interp(series[0], rays[0], rays[1].phase_bias[0])
    assert np.mean(np.abs(f - g) > 1.5 * claimed) < 0.03


def test_auto_keeps_to_the_tolerance_and_to_what_pays():
    def at(radius, tolerance, **options):
        component = Component("spheres", np.array([1.33 + 0j]), population(size("lognormal", radius=radius, sigma=1.3)))
        return expected([component], [0.6], [1.0], Aim(tolerance, rays=Rays(**options)))[2][0]

    assert not at(10.0, 0.1).taken and "save time" in at(10.0, 0.1).why  # x = 105: accurate enough, but dearer
    large = at(300.0, 0.01)
    assert large.taken and large.error <= 0.01 and large.saved > 0.2 and "saves" in large.why
    assert not at(300.0, 1e-4).taken and "off by" in at(300.0, 1e-4).why  # hardly ever good enough
    loose = at(300.0, 0.1)
    assert loose.switch <= large.switch
    # a setting that spoils rays has to push them up or out: the measure sees it
    crude = at(300.0, 0.01, edge=None, rainbow=False, orders=1)
    assert not crude.taken or crude.switch > large.switch
    assert not at(300.0, 0.01, method="mie").taken


def test_the_smallest_sizes_stay_with_series():
    theta, found = bake(1.33, 2.0, 2.0, Rays("goa"))
    x = found.radius * 2 * math.pi / 0.6
    choice = found.choices[0]
    assert x.min() < 10 < choice.switch and choice.switch >= LOWEST
    fixed = bake(1.33, 2.0, 2.0, Rays("goa", switch=80.0))[1].choices[0]
    assert 80 <= fixed.switch < 100 and fixed.error < choice.error


def test_polarised_elements_by_rays_obey_their_bounds():
    theta, found = bake(1.33, 8.0, 1.3, Rays("goa"), polarized=True)
    s11, s12, s33, s34 = found.elements[0]
    assert (s12**2 + s33**2 + s34**2 <= s11**2 * (1 + 1e-9)).all()
    # backwards and forwards a sphere keeps its symmetry: no linear polarisation
    assert abs(s12[0]) < 1e-6 * s11[0] and abs(s12[-1]) < 1e-6 * s11[-1]


def test_equal_spheres_have_a_measured_error_too():
    component = Component("spheres", np.array([1.33 + 0j]), population(size("single", radius=20.0)))
    theta, found = averages([component], [0.6], [1.0], Aim(0.1, rays=Rays("goa")))
    assert 0.01 < found[0].choices[0].error < 0.1


@pytest.mark.parametrize("count", [3, 33, 200])
def test_a_fixed_number_of_sizes_and_angles(count):
    theta, found = bake(1.33, 2.0, 1.5, Rays("mie"), radii=count, angles=count)
    assert len(theta) == count and abs(len(found.radius) - count) <= 3
    reference = by("mie", 1.33, 2.0, 1.5)
    exact = phase.phase_at(reference[0], reference[1].elements[0, 0], theta)
    if count > 3:  # its error is told, and covers the truth
        assert np.max(np.abs(found.elements[0, 0] / exact - 1)) < found.error[0] + 0.03


def test_the_choice_does_not_depend_on_the_workers():
    blocks = []

    def backwards(function, tasks):
        blocks.append(len(tasks))
        return [function(*task) for task in tasks[::-1]][::-1]

    one, other = by("goa", 1.33, 6.0), bake(1.33, 6.0, 1.3, Rays("goa"), map=backwards)
    assert np.array_equal(one[1].elements, other[1].elements) and len(blocks) > 2


@pytest.mark.slow
def test_the_light_as_a_whole_takes_no_more_angles_than_every_angle_and_its_work_is_foreseen():
    """Hail: ripples of its few spheres took 11,896 angles at 3 % of the light, where 401 do for 10 % at every angle."""
    sizes = population(size("lognormal", radius=1000.0, sigma=1.5, min=500.0, max=3000.0))
    hail = [Component("hail", np.array([1.31 + 0j]), sizes)]
    done = []
    made, *_ = expected(hail, [0.55], [1.0], Aim(0.03, rays=Rays(), integrated=True))
    theta, found = averages(hail, [0.55], [1.0], Aim(0.03, rays=Rays(), integrated=True),
                            report=lambda seconds, error: done.append(seconds))
    every, *_ = expected(hail, [0.55], [1.0], Aim(0.03, rays=Rays()))
    assert found[0].error[0] <= 0.03
    assert made.angles / 2 < len(theta) < min(2 * made.angles, 600)
    assert 1 / 3 < made.seconds / (done[-1] + 0.025) < 3
    assert made.seconds < every.seconds


def test_comparisons_take_fewer_spheres_where_they_are_dear():
    """A plan waits for them: drops up to 7 cm would take a minute with all samples."""
    wide = size("lognormal", radius=200.0, sigma=5.3, max=70_000.0)
    spheres = []

    def count(measure, m, x, weight, *more):
        spheres.append((len(x), sum(weight)))
        return None

    for s in (wide, size("lognormal", radius=200.0, sigma=1.3)):
        choose(channels_of([Component("drops", np.array([1.33 + 0j]), population(s))], [0.55], [1.0], 0.03), 0.03, Rays(), count)
    assert spheres[0][0] < 40 and spheres[1][0] == 128
    assert [total for _, total in spheres] == pytest.approx([1, 1])
