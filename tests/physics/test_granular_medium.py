"""The medium that stands for grains, in their mesh: closed forms, a white world, and Mitsuba's `volpath`.

Comparisons with chance go wrong once in 1e7 seeds; seeds are fixed.
"""

import numpy as np
import pytest

from bakery import kernels
from bakery.store import ply
from renderers.materials.grains import material, medium, methods, transport
from renderers.materials.grains._medium import Medium
from renderers.mitsuba.world import World
from tests.conftest import slow
from tests.odds import ODDS, SIGMAS, sigmas
from tests.physics.particles import THETA, Sky, blocks, camera, henyey_greenstein, same
from tests.physics.test_aggregate import bumpy, rays, tile, winding
from tests.physics.test_granular_render import COLOURS, NOTHING, SCENE, passes

MESH = bumpy(6.0, (0.3, 0.2, 0.1))


def continuous(sigma_t, albedo, g=0.0, world=None, mesh=MESH):
    """A medium of three wavelengths in the mesh; g (3,) or a number."""
    layouts = [kernels.phase_layout(THETA, henyey_greenstein(one)) for one in np.broadcast_to(g, 3)]
    aggregate, sigma_t = kernels.aggregate(*tile(0.5, 40), *mesh), np.array(np.broadcast_to(sigma_t, 3), float)
    phase, cdf = (np.array([one[k] for one in layouts]) for k in (2, 3))
    found = Medium(aggregate, 1.0, sigma_t, np.array(np.broadcast_to(albedo, 3), float), layouts[0][0], layouts[0][1], phase, cdf,
                   material.seldom(aggregate, sigma_t.min()))
    around = NOTHING if world is None else material.occupied_by(world, aggregate, 1.0)
    return medium.Continuous(found, around, COLOURS)


def test_the_depth_is_not_more_than_it_is():
    """Points of voxels are inside within what is said to be their depth, in any direction."""
    aggregate = kernels.aggregate(*tile(0.5, 40), *bumpy(40.0))
    found, random = kernels.depth_in_mesh(aggregate), np.random.default_rng(1)
    index = np.argwhere(found > 0)[:: max(1, (found > 0).sum() // 300)]
    point = aggregate.low + (index + random.random(index.shape)) * aggregate.edge
    way = random.normal(size=point.shape)
    way *= (found[tuple(index.T)] / np.linalg.norm(way, axis=1))[:, None]
    assert len(index) > 100 and found.max() > 8 and winding(point + 0.999 * way, *bumpy(40.0)).all()


@pytest.mark.slow
def test_absorption_is_that_of_the_way_inside():
    """Albedo 0: what comes through is exp(-sigma_t s), s the sum of the ways inside from far away, in and out of the dents."""
    how = continuous([0.1, 0.2, 0.3], 0.0)
    origin, direction = rays(MESH[0], 300, 2)
    steps = np.linspace(0, 2 * np.linalg.norm(np.ptp(MESH[0], axis=0)) + 4, 1500)
    share = np.empty((300, 3))
    how.transmittance(origin, direction, np.full(300, 1e12), share)
    for o, d, found in zip(origin[::20], direction[::20], share[::20]):
        inside = winding(o + (steps[:, None] + 1e-4) * d, *MESH).sum() * steps[1]
        assert -np.log(found) == pytest.approx(inside * how.medium.sigma_t, abs=0.3 * steps[1] * 4)
    view = camera((64, 64), (0.0, -40.0, 3.0), (0.0, 0.0, 0.0), 16)
    picture = passes(Sky(above=1, below=1), how, view, (64, 64), range(12)).mean(axis=(1, 2))
    fine = camera((256, 256), (0.0, -40.0, 3.0), (0.0, 0.0, 0.0), 16).rays(256, 256).reshape(-1, 3)
    through = np.empty((len(fine), 3))
    how.transmittance(np.tile(view.origin, (len(fine), 1)), fine, np.full(len(fine), 1e12), through)
    error = picture.std(axis=0, ddof=1) / np.sqrt(12)
    assert error.max() < 4e-3 and np.all(np.abs(picture.mean(axis=0) - through.mean(axis=0)) < sigmas(12) * error)


@pytest.mark.parametrize("sigma_t, g", [([0.5, 0.7, 1.0], [0.0, 0.3, 0.5]), slow(3.0, -0.3)], ids=["thin", "thick"])
def test_nothing_is_lost(sigma_t, g):
    """Lossless in light from everywhere: 1, at all wavelengths, whether lights are sampled often or seldom."""
    how = continuous(sigma_t, 1.0, g)
    found = passes(Sky(above=1, below=1), how, camera((24, 24), (0.0, -25.0, 3.0), (0.0, 0.0, 0.0), 34), (24, 24), range(40))
    mean = found.mean(axis=(1, 2))
    error = mean.std(axis=0, ddof=1) / np.sqrt(40)
    assert error.max() < 6e-3 and np.all(np.abs(mean.mean(axis=0) - 1) < SIGMAS * error)


@pytest.mark.slow
def test_the_loop_is_the_walk(tmp_path):
    """By order and by light: two media whose wavelengths differ, in meshes that touch, with a floor through them."""
    (tmp_path / "scene.xml").write_text(SCENE.replace("MORE", ""))
    world, (vertices, faces) = World(tmp_path / "scene.xml", size=(9, 12)), bumpy(2.0)
    meshes = [(vertices + side * np.array([abs(vertices[:, 0]).max(), 0, 0]), faces) for side in (-1, 1)]
    ways = [continuous([0.5, 1.0, 2.0], [0.99, 0.9, 0.6], [0.0, 0.3, 0.6], world, meshes[0]),
            continuous(0.8, 0.95, -0.3, world, meshes[1])]
    bodies = tuple(transport.Body(None, way, 1.0) for way in ways)
    part = methods.medium_part(bodies, meshes, COLOURS, world, 0)
    loop = [part.render(number) for number in range(24)]
    sums = [transport.one_pass(world, transport.Transport(bodies, COLOURS, transport.MEDIUM), world.camera, (9, 12), number, 0)
            for number in range(24)]
    agree(loop, sums, world.light_names, 0.02)


def agree(layers, sums, lights, most):
    """Passes of a loop, by their layers, and of wavefronts, by their sums, agree by order and by light, with errors of at most so
    much of the picture."""
    count, names = len(layers), ("order0", "order1", "order2", "orders")
    compared = [([one[name] for one in layers], [one.by_order[order] for one in sums]) for order, name in enumerate(names)]
    compared += [([one[f"light.{name}"] for one in layers], [one.by_light[light] for one in sums])
                 for light, name in enumerate(lights)]
    whole = np.mean([one[""] for one in layers])
    for ours, theirs in compared:
        means = [np.array(pictures).reshape(count, -1, 3).mean(axis=1) for pictures in (ours, theirs)]
        error = np.hypot(*(mean.std(axis=0, ddof=1) for mean in means)) / np.sqrt(count)
        apart = np.abs(means[0].mean(axis=0) - means[1].mean(axis=0))
        assert error.max() < most * whole
        assert np.all(apart < sigmas(count, comparisons=3 * len(compared)) * error)


@pytest.mark.slow
def test_mitsuba_sees_the_same_medium(tmp_path):
    """Pixel by pixel, with a floor through it, a lamp and a sky, against `volpath`."""
    import mitsuba as mi

    vertices, faces = bumpy(4.0)
    (tmp_path / "mesh.ply").write_bytes(ply.mesh(vertices, faces))
    inside = ('<shape type="ply"><string name="filename" value="mesh.ply"/><bsdf type="null"/><medium type="homogeneous" '
              'name="interior"><rgb name="albedo" value="0.99 0.9 0.6"/><float name="sigma_t" value="0.8"/>'
              '<phase type="hg"><float name="g" value="0.4"/></phase></medium></shape>')
    (tmp_path / "explicit.xml").write_text(SCENE.replace("MORE", inside).replace('type="path"', 'type="volpath"'))
    (tmp_path / "scene.xml").write_text(SCENE.replace("MORE", ""))
    world = World(tmp_path / "scene.xml", size=(72, 96))
    how = continuous(0.8, [0.99, 0.9, 0.6], 0.4, world, (vertices, faces))
    ours = blocks(passes(world, how, world.camera, (72, 96), range(12)), (6, 8))
    scene = mi.load_file(str(tmp_path / "explicit.xml"))
    theirs = blocks(np.array([np.array(mi.render(scene, seed=seed, spp=16))[..., :3] for seed in range(12)]), (6, 8))
    noisy = theirs.std(axis=0) > 1e-4  # where there is nothing but sky, they differ by rounding
    assert np.allclose(ours.mean(axis=0)[~noisy], theirs.mean(axis=0)[~noisy], rtol=1e-5)
    assert same(ours[:, noisy], theirs[:, noisy]) > ODDS
    assert same(ours[:, noisy], 1.05 * theirs[:, noisy]) < ODDS, "nothing would be seen"
