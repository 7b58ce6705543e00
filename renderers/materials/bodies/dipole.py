"""The directional dipole, for comparison: light that leaves a body as if it had diffused under a plane boundary.

Of light scattered twice and more.  Approximate: diffusion, in the half space under the tangent of where light comes in; so it is
wrong near that place, in thin and curved parts, and of light that goes on forward or is absorbed soon.  Light scattered once is
in it, too, which diffusion does not tell apart: with it rendered on its own, as is usual, pictures are too bright.
"""

import numpy as np

from bakery import kernels
from renderers.materials.bodies import _dipole, _geometry, gather, smooth, surfaces, transport
from renderers.materials.bodies._walk import Walk
from renderers.materials.bodies.setup import Sums
from renderers.threads import run
from renderers.transport.paths import joined

_MILNE = 2.131  # extrapolation length over d at a boundary that reflects nothing (Davison 1957)


def moments(index):
    """Of Fresnel's reflectance R over cosines c from 0 to 1: 2 int R c dc, 3 int R c^2 dc; index beyond over that before."""
    if index == 1.0:
        return 0.0, 0.0
    # R has the slope of a root where total reflection begins
    edge = np.sqrt(max(1 - index**2, 0.0))
    x, weight = np.polynomial.legendre.leggauss(64)
    c, weight = edge + (1 - edge) * ((x + 1) / 2) ** 2, weight * (1 - edge) * (x + 1) / 2
    r = np.array([kernels.fresnel(cosine, index)[0] for cosine in c])
    return edge**2 + 2 * np.sum(weight * r * c), edge**3 + 3 * np.sum(weight * r * c**2)


def dipole_of(body) -> _dipole.Dipole:
    """What the dipole is made of, at each wavelength."""
    medium, reduced = body.medium, smooth.reduced(body.medium)
    d, absorbed = 1 / (3 * reduced), medium.sigma_t * (1 - medium.albedo)
    (first, second), (outside, _) = moments(1 / body.index), moments(body.index)
    c_phi, c_e = (1 - first) / 4, (1 - second) / 2
    end = _MILNE * d / np.sqrt(np.maximum(1 - absorbed / reduced, 1e-6))
    same = np.ones(len(d))
    return _dipole.Dipole(d, np.sqrt(absorbed / d), medium.sigma_t, end * (1 - c_e) / (2 * c_phi), end, c_phi * same, c_e * same,
                          body.index**2 / (np.pi * (1 - outside)) * same)


def seen(setup, beams, picks, key) -> np.ndarray:
    """Light (pixels, 3), linear sRGB, that dipoles send to the eye in a pass.

    setup : `setup.Transport`
    beams : of each body, `_gather.Beams` that begin where light comes in;  picks : of them, drawn for a line of sight
    key : uint64, of the pass: its random numbers
    """
    dipoles = [dipole_of(body) for body in setup.bodies]
    normals = [surfaces.facing(setup, its) for its in beams]
    pixels = setup.world.size[0] * setup.world.size[1]
    sums = Sums(pixels, by_paths=False)
    paths = transport.begin(setup, np.arange(pixels), key)
    while paths.count:
        body = surfaces.located(setup.geometry, paths)
        parts = [surfaces.at_surfaces(setup, paths.of(body == _geometry.OUTSIDE), sums)]
        for at in np.unique(body[body != _geometry.OUTSIDE]):
            lines = paths.of(body == at)
            _gathered(setup, lines, at, dipoles[at], beams[at], normals[at], picks, sums)
            # what is not scattered goes on beyond the body; the dipole knows of light that is turned back in it
            done = joined(transport.inside(setup, lines, at, 0, sums, None))
            parts.append(done.of(surfaces.located(setup.geometry, done) != at))
        paths = joined(parts)
    return sums.gathered


def _gathered(setup, paths, number, dipole, beams, normal, picks, sums):
    """Adds what leaves a body where paths come in."""
    if not len(beams.length):
        return
    order = gather.by_place(paths.origin, setup.bodies[number].vertices)
    lines = paths.of(order)
    brought, groups = np.empty(lines.throughput.shape), -(-lines.count // _dipole.TOGETHER)
    facing = surfaces.facing(setup, lines)
    run(_dipole.gather, groups, dipole, beams, normal, picks, lines.part(Walk), facing, brought, block=16)
    paths.states[order] = lines.states
    sums.add_gathered(lines, brought * lines.throughput @ setup.colours.to_rgb.T)
