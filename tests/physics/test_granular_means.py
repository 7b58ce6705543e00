"""Means of every method of grains to 1 % at three standard errors: lossless grains in a white world are white.

What light samples and directions count together is exactly 1, so a density or weight that is a few per cent off is seen in the
mean.  Comparisons with chance go wrong once in 1e7 seeds; seeds are fixed.
"""

import numpy as np
import pytest

from bakery import kernels
from renderers.materials.grains import medium, transport
from tests.odds import SIGMAS
from tests.physics.particles import Sky, averaged, camera
from tests.physics.test_aggregate import bumpy, tile
from tests.physics.test_granular_medium import continuous
from tests.physics.test_granular_render import COLOURS, GLASS, MATT, NOTHING, STONE, Kind, grains, place, through
from tests.physics.test_granular_teleport import place as teleports
from tests.physics.test_granular_transport import joined

pytestmark = pytest.mark.slow

CLOSE = camera((24, 24), (0.0, -40.0, 3.0), (0.0, 0.0, 0.0), 10)  # nothing but the body is seen
KINDS = [Kind(MATT), Kind(GLASS, STONE)]
BODY = bumpy(6.0)


def seldom():
    """A medium of which one scattering in four samples a light."""
    how = continuous(0.7, 1.0, mesh=BODY)
    return medium.Continuous(how.medium._replace(chance=np.full_like(how.medium.chance, 0.25)), NOTHING, COLOURS)


def diffusing():
    """A body so large that light diffuses far inside."""
    how = continuous(3.0, 1.0, 0.3, mesh=BODY)
    return medium.Continuous(how.medium, NOTHING, COLOURS, diffuse=True)


def varied():
    """A medium that is denser on one side."""
    how = continuous(1.0, 1.0, 0.3, mesh=BODY)
    share = kernels.field([-9.0] * 3, [9.0] * 3, np.linspace(0.3, 1.0, 5).reshape(5, 1, 1))
    denser = kernels.varied_medium(share, kernels.uniform_field(), 0.5, 1.0, np.ones((1, 3)), np.full((1, 3), 1.0), np.zeros(3))
    return medium.Continuous(how.medium._replace(sigma_t=np.full(3, denser.most)), NOTHING, COLOURS, varied=denser)


WAYS = {"vpt, isotropic": lambda: continuous(0.7, 1.0, mesh=BODY), "vpt, forward": lambda: continuous(0.7, 1.0, 0.6, mesh=BODY),
        "vpt, seldom": seldom, "vpt, varied": varied, "vpt+da": diffusing,
        "ept": lambda: place(grains(KINDS, BODY, tile(0.4, 40))),
        "teleport": lambda: teleports(grains(KINDS, BODY, tile(0.4, 40))),
        "ept+vpt": lambda: joined([grains(KINDS, BODY, tile(0.4, 40))])}


@pytest.mark.parametrize("name", WAYS)
def test_white_grains_in_a_white_world(name):
    """Densities of directions that are 5 % off, in the weights of light samples or of paths, change the mean of the medium by 0.7
    to 1.3 %; here it is known to 0.1 %."""
    how = through(WAYS[name]())
    sky = Sky(above=1, below=1)
    first = 1000 * list(WAYS).index(name)
    mean, error = averaged([transport.one_pass(sky, how, CLOSE, (24, 24), number, 0).by_order.sum(axis=0).mean()
                            for number in range(first, first + 400)])
    assert 3 * error < 0.01 and abs(mean - 1) < SIGMAS * error
