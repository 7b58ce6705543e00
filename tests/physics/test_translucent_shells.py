"""Jumps by stored exits from spheres: explicit walks, a white world, and the same pictures as event by event.

Comparisons with chance go wrong once in 1e7 seeds; seeds are fixed.
"""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from bakery.physics.shapes.radial import icosphere
from bakery.store import ply
from renderers.materials.bodies import _shells, methods, shells
from renderers.materials.bodies.bodies import Body, laid_out
from renderers.materials.bodies.setup import Transport
from renderers.mitsuba.world import World
from renderers.transport.paths import Colours
from renderers.transport.scattering import scatterer
from tests.conftest import slow
from tests.odds import ODDS, sigmas
from tests.physics.media import angles, henyey_greenstein

SIGMA, G = np.array([1.0, 0.8, 1.2]), np.array([0.0, 0.5, 0.7])
ALBEDO = np.array([0.95, 0.99, 0.9])
SKY = '<emitter type="constant"><rgb name="radiance" value="1 1 1"/></emitter>'
PANEL = """<shape type="rectangle" id="panel"><transform name="to_world"><scale value="8"/><rotate x="1" angle="180"/>
<translate x="3" y="-3" z="18"/></transform><emitter type="area"><rgb name="radiance" value="4 4 4"/></emitter></shape>"""
POINT = '<emitter type="point"><point name="position" x="0" y="-30" z="0"/></emitter>'
SCENE = """<scene version="3.0.0"><sensor type="perspective"><float name="fov" value="34"/><transform name="to_world">
<lookat origin="0, -45, 12" target="0, 0, 0" up="0, 0, 1"/></transform><film type="hdrfilm"><integer name="width" value="8"/>
<integer name="height" value="8"/><rfilter type="box"/></film></sensor>AROUND<shape type="ply" id="ball">
<string name="filename" value="ball.ply"/>BOUNDARY</shape></scene>"""
BOUNDARY = {1.0: '<bsdf type="null"/>', 1.4: '<bsdf type="dielectric"><float name="int_ior" value="1.4"/>'
            '<float name="ext_ior" value="1"/></bsdf>'}


def medium(albedo=ALBEDO):
    theta = angles()
    return scatterer(SIGMA, np.broadcast_to(albedo, 3), theta, henyey_greenstein(G, theta))


def transport(folder, around, index, albedo=ALBEDO):
    """A ball of about 11 mean free paths, in which paths jump, and the same in which they do not."""
    vertices, faces = icosphere(320)
    (folder / "ball.ply").write_bytes(ply.mesh(vertices * 11, faces))
    (folder / "scene.xml").write_text(SCENE.replace("AROUND", around).replace("BOUNDARY", BOUNDARY[index]))
    world = World(folder / "scene.xml")
    body = Body("ball", vertices * 11, faces, index, True, medium(albedo), [], False, shells.none(3))
    how = Transport(world, *laid_out(world, [body], ValueError), Colours(np.eye(3), np.eye(3)), [[]])
    return shells.laid(how), how


def means(how, name, count, *layers, seed=0):
    """(passes, 3) means of pictures, of each layer."""
    part = methods.parts(how, name, "none", seed)[0]
    rendered = [part.render(number) for number in range(count)]
    return [np.array([each[layer].mean(axis=(0, 1)) for each in rendered]) for layer in layers]


def walked(radius, wave, count, rng):
    """Weight, z of the place over the radius, cosine between direction and place, of walks from the centre along z."""
    p, d = np.zeros((count, 3)), np.tile([0.0, 0.0, 1.0], (count, 1))
    weight, inside, g = np.ones(count), np.ones(count, bool), G[wave]
    while inside.any():
        along = np.einsum("nk,nk->n", p, d)
        far = np.sqrt(along**2 + radius**2 - np.einsum("nk,nk->n", p, p)) - along
        t = rng.exponential(1 / SIGMA[wave], count)
        out = inside & (t >= far)
        p[inside] += np.minimum(t, far)[inside, None] * d[inside]
        inside &= ~out
        u = rng.random(count)
        c = 2 * u - 1 if g == 0 else (1 + g * g - ((1 - g * g) / (1 - g + 2 * g * u)) ** 2) / (2 * g)
        side = np.cross(d, rng.normal(size=(count, 3)))
        side /= np.linalg.norm(side, axis=1)[:, None]
        turned = c[:, None] * d + np.sqrt(1 - c**2)[:, None] * side
        d[inside] = turned[inside] / np.linalg.norm(turned[inside], axis=1)[:, None]
        weight[inside] *= ALBEDO[wave]
    return weight, p[:, 2] / radius, np.einsum("nk,nk->n", p, d) / radius


@pytest.mark.slow
def test_stored_exits_are_those_of_walks():
    """Power and moments that leave a sphere whose walks jump by three smaller ones, of light with unequal weights: within
    0.02, more than five standard errors of each of the nine."""
    made = shells.stored(medium(), 6.0)
    at, begun = len(made.radii) - 1, np.array([0.2, 1.0, 0.6])
    assert at >= 3
    rng, count = np.random.default_rng(7), 40_000
    origin, direction, weight = np.zeros((count, 3)), np.tile([0.6, 0.0, 0.8], (count, 1)), np.tile(begun, (count, 1))
    along = direction[0].copy()
    states = rng.integers(0, 2**63, count).astype(np.uint64)
    jumped(made, at, origin, direction, weight, states)
    np.testing.assert_allclose(np.linalg.norm(origin, axis=1), made.radii[at], rtol=1e-6)
    place, slope = origin @ along / made.radii[at], np.einsum("nk,nk->n", origin, direction) / made.radii[at]
    for wave in range(3):
        found = [np.mean(weight[:, wave] / begun[wave] * value) for value in (1.0, place, slope)]
        power, z, mu = walked(made.radii[at], wave, 20_000, rng)
        np.testing.assert_allclose(found, [power.mean(), (power * z).mean(), (power * mu).mean()], rtol=0, atol=0.02)


def jumped(made, at, origin, direction, weight, states):
    paths = SimpleNamespace(origin=origin, direction=direction, throughput=weight, states=states)
    for i in range(len(states)):
        _shells.jump.py_func(made, at, paths, i)


@pytest.mark.slow
@pytest.mark.parametrize("index", [1.0, 1.4])
def test_a_white_world_stays_white(index, tmp_path):
    how, _ = transport(tmp_path, SKY, index, albedo=1.0)
    # of all wavelengths together: what one gains by chance another loses, however many jumps there are
    found = means(how, "shells", 16, "")[0].mean(axis=1)
    noise = found.std(ddof=1) / len(found)**0.5
    assert noise < 0.02
    assert abs(found.mean() - 1) < sigmas(len(found)) * noise + 1e-6


@pytest.mark.parametrize(("index", "around"), [slow(1.0, PANEL), slow(1.4, SKY)])  # paths seldom find a panel through glass
def test_jumps_and_events_agree(index, around, tmp_path, count=40):
    jumps, events = transport(tmp_path, around, index)
    layers = "", "order1", "order2"
    of_jumps, of_events = means(jumps, "shells", count, *layers), means(events, "paths", count, *layers, seed=1)
    for layer, ours, theirs in zip(layers, of_jumps, of_events, strict=True):
        assert np.all(stats.ttest_ind(ours, theirs, equal_var=False).pvalue > ODDS), layer
        # orders that jumps leave alone are rare in a ball as large as this
        assert layer or np.all(ours.std(axis=0, ddof=1) < 0.2 * count**0.5 * ours.mean(axis=0)), "nothing would be seen"


def test_bodies_among_lights_without_extent(tmp_path):
    """Paths inside find no point: those without a boundary are followed event by event, and it is said."""
    how, _ = transport(tmp_path, POINT, 1.0)
    assert len(how.bodies[0].shells.radii) == 0
    assert any("event by event" in one for one in shells.reasons(how))
