"""The directional dipole, for comparison: light that leaves a body as if it had diffused under a plane boundary.

Of light scattered twice and more.  Approximate: diffusion, in the half space under the tangent of where light comes in; so it is
wrong near that place, in thin and curved parts, and of light that goes on forward or is absorbed soon.  Light scattered once is
in it, too, which diffusion does not tell apart: with it rendered on its own, as is usual, pictures are too bright.
"""

from __future__ import annotations

import numpy as np

from bakery import kernels
from renderers.materials.bodies import _dipole, _geometry, smooth, transport
from renderers.materials.bodies.paths import joined
from renderers.materials.bodies.transport import Sums
from renderers.threads import run

_TOGETHER = 64  # lines of sight, near each other, that draw places by one guess
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


def seen(setup, beams, picks, number, seed) -> np.ndarray:
    """Light (pixels, 3), linear sRGB, that dipoles send to the eye in a pass.

    setup : `transport.Transport`
    beams : of each body, `_gather.Beams` that begin where light comes in;  picks : of them, drawn for a line of sight
    number, seed : of the pass
    """
    dipoles = [dipole_of(body) for body in setup.bodies]
    normals = [np.empty(lit.origin.shape) for lit in beams]
    for lit, normal in zip(beams, normals, strict=True):
        run(_dipole.boundary_normals, len(normal), setup.geometry, lit.origin, lit.direction, normal)
    pixels = setup.world.size[0] * setup.world.size[1]
    sums = Sums(pixels, by_paths=False)
    paths = transport.begin(setup, np.arange(pixels), number, seed)
    while len(paths):
        body, far, triangle = transport.located(setup.geometry, paths)
        out = body == _geometry.OUTSIDE
        parts = [transport.at_surfaces(setup, paths.of(out), sums, far[out], triangle[out])]
        for at in np.unique(body[~out]):
            in_it = body == at
            lines = paths.of(in_it)
            _gathered(setup, lines, at, dipoles[at], beams[at], normals[at], picks, sums)
            # what is not scattered goes on beyond the body; the dipole knows of light that is turned back in it
            done = joined(transport.inside(setup, lines, at, far[in_it], triangle[in_it], [0] * len(setup.bodies), sums, None))
            parts.append(done.of(transport.located(setup.geometry, done)[0] != at))
        paths = joined(parts)
    return sums.gathered


def _gathered(setup, paths, number, dipole, beams, normal, picks, sums):
    """Adds what leaves a body where paths come in."""
    if not len(beams.length):
        return
    order = transport.by_place(paths.origin, setup.bodies[number].vertices)
    lines = paths.of(order)
    n = len(lines)
    around, facing, brought = np.append(np.arange(0, n, _TOGETHER), n), np.empty((n, 3)), np.empty(lines.weight.shape)
    run(_dipole.boundary_normals, n, setup.geometry, lines.origin, lines.direction, facing)
    run(_dipole.gather, len(around) - 1, dipole, beams.origin, beams.direction, beams.power, normal, picks, around, lines.origin,
        facing, lines.states, brought, block=16)
    paths.states[order] = lines.states
    sums.add_gathered(lines, brought * lines.weight @ setup.colours.to_rgb.T)
