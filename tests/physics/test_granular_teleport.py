"""Teleports: nothing is lost, absorption and flights have their exact means, light gets as far as independent steps say.

Comparisons with chance go wrong once in 1e7 seeds; seeds are fixed.
"""

import numpy as np
import pytest

from bakery import kernels
from benchmarks.figures_granular import walks
from renderers.materials.grains import material
from renderers.materials.grains.teleport import Teleports, flights
from renderers.mitsuba.world import World
from tests.odds import SIGMAS
from tests.physics.particles import Sky, averaged, camera
from tests.physics.test_aggregate import CUBE, bumpy, tile
from tests.physics.test_granular_render import ALL_AROUND, COLOURS, GLASS, MATT, NOTHING, STEEL, STONE, Kind, grains, passes

pytestmark = pytest.mark.slow  # kernels that no quicker test compiles

LARGE = (1000.0 * (2 * CUBE[0] - 1), CUBE[1])


def place(found, world=None, **law):
    occupied = NOTHING if world is None else material.occupied_by(world, found.aggregate, found.unit)
    return Teleports(found, occupied, COLOURS, **law)


def test_flights_are_the_tile_s():
    """Mean 4 V/S, the second moment of a tile of the walks at fraction 0.6 (0.944 to 0.2 %, ours to 0.4 %), or Dixmier's 1."""
    aggregate = grains([Kind(GLASS)], LARGE, tile(0.6, 500)).aggregate
    for exponential, wished in ((False, 0.944), (True, 1.0)):
        law = flights(aggregate, exponential=exponential)
        assert law.void.mean() == pytest.approx(8 / 9, rel=1e-9)
        assert (law.void**2).mean() / (2 * law.void.mean() ** 2) == pytest.approx(wished, rel=0.02)


def test_nothing_is_lost_at_smooth_grains():
    """In light from everywhere each single path brings 1."""
    found = place(grains([Kind(GLASS), Kind(GLASS, STONE), Kind(STEEL, STONE), Kind(STEEL, radius=0.7)], bumpy(9.0)))
    assert np.allclose(passes(Sky(above=1, below=1), found, ALL_AROUND, (24, 24), [0]), 1.0, rtol=1e-12)


def test_matt_white_grains_in_light_from_everywhere():
    """Light samples, whose way is drawn, and directions of the path together count all light once."""
    found = place(grains([Kind(MATT), Kind(MATT, STONE), Kind(GLASS, STONE)], bumpy(6.0), tile(0.3, 40)))
    picture = passes(Sky(above=1, below=1), found, camera((8, 8), (0.0, -25.0, 3.0), (0.0, 0.0, 0.0), 34), (8, 8), range(200))
    mean, error = averaged(picture.mean(axis=(1, 2, 3)))
    assert error < 3e-3 and abs(mean - 1) < SIGMAS * error


@pytest.mark.parametrize("size", [9.0, 2.0])
def test_rays_pass_as_much_of_the_grains_as_the_mesh_holds(size):
    """Balls of the host's index only absorb.  Over a parallel beam the mean way in them is f V over its area, exactly: spheres
    are there whose centre is inside, however rays go through the surface of the mesh."""
    vertices, faces = bumpy(size)
    found = grains([Kind(kernels.dielectric(1.0), radius=0.9), Kind(kernels.dielectric(1.0), radius=0.6)], (vertices, faces))
    found.absorption[:] = [[0.0, 1e-3, 1e-3]]  # at one wavelength nothing, so that no path is ended by chance
    far, wide = 1e6, 4 * size
    view = camera((48, 48), (0.0, -far, 0.0), (0.0, 0.0, 0.0), np.degrees(2 * np.arctan(wide / 2 / far)))
    picture = passes(Sky(above=1, below=1), place(found), view, (48, 48), range(16))[..., 1]
    mean, error = averaged(-np.log(picture).mean(axis=(1, 2)))
    corner = [vertices[faces[:, k]] for k in range(3)]
    volume = np.sum(corner[0] * np.cross(corner[1], corner[2])) / 6
    wished = 1e-3 * 0.6 * (0.9**3 + 0.6**3) / 2 * volume / wide**2
    assert error < 0.02 * wished and abs(mean - wished) < SIGMAS * error


def test_light_gets_as_far_as_independent_steps_take_it():
    """Mean flight from hit to hit (Eq. 3) and growth of the mean square displacement a hit, glass balls of radius 1 and 0.8."""
    spheres = tile(0.6, 200)
    for radius, numbers in ((1.0, (1.0, 0.0, 1.42435480, 0.65008941, 2.84887315)), (0.8, (0.64, 0.8, None, None, None))):
        found = grains([Kind(GLASS, radius=radius)], LARGE, spheres)
        law = flights(found.aggregate)
        walked = walks.among_grains(found, 12_000, [], (16, 32), law=law)
        beta, delta, lambda_s, g, square = numbers
        wished = law.void.mean() / beta + delta * (1 - beta) / beta
        mean, error = averaged(walked.flight)
        assert error < 0.01 * wished and abs(mean - wished) < SIGMAS * error
        if lambda_s:
            z, second = law.void.mean(), (law.void**2).mean()
            wished = second + 2 * z * lambda_s + square + 2 * (z + lambda_s) * (z * g + lambda_s) / (1 - g)
            mean, error = averaged((walked.squares[:, 1] - walked.squares[:, 0]) / 16)
            assert error < 0.016 * wished and abs(mean - wished) < SIGMAS * error


def test_the_same_bytes_whatever_threads(monkeypatch):
    from renderers import threads

    found = place(grains([Kind(GLASS, STONE), Kind(MATT)], bumpy(6.0)))
    view = camera((80, 64), (0.0, -25.0, 3.0), (0.0, 0.0, 0.0), 34)
    several = passes(Sky((0, 1, -1), above=1), found, view, (80, 64), [5])
    monkeypatch.setattr(threads, "_pool", lambda: threads.ThreadPoolExecutor(1))
    assert np.array_equal(several, passes(Sky((0, 1, -1), above=1), found, view, (80, 64), [5]))


WHITE = """<scene version="3.0.0"><sensor type="perspective"/>
<shape type="rectangle"><transform name="to_world"><scale value="5"/><translate z="-1.5"/></transform>
<bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="1 1 1"/></bsdf></bsdf></shape>
<emitter type="constant"><rgb name="radiance" value="1 1 1"/></emitter></scene>"""


def test_a_white_floor_through_the_grains(tmp_path):
    """A floor that reflects all light, in a white world: radiance 1 everywhere, whether light comes by samples or by paths."""
    (tmp_path / "white.xml").write_text(WHITE)
    world = World(tmp_path / "white.xml")
    kinds = [Kind(GLASS), Kind(MATT, STONE), Kind(STEEL), Kind(GLASS, STONE)]
    found = place(grains(kinds, bumpy(4.0), tile(0.4, 40)), world)
    assert found.occupied.any()
    picture = passes(world, found, camera((48, 48), (0.0, -15.0, 3.0), (0.0, 0.0, -0.5), 36), (48, 48), range(16))
    mean, error = averaged(picture.mean(axis=(1, 2, 3)))
    assert error < 3e-3 and abs(mean - 1) < SIGMAS * error
