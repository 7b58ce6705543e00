"""Lines of sight through bodies, and the light of beams that they gather."""

from typing import NamedTuple

import numpy as np

from renderers.materials.bodies import _choice, _gather
from renderers.materials.bodies.paths import thinned
from renderers.materials.bodies.surfaces import facing
from renderers.threads import run
from renderers.transport import wavefront
from renderers.transport.scattering import mean_cosines


class Gather(NamedTuple):
    """How lines of sight gather beams.

    beams : of each body, `_gather.Beams`
    later : whether third and later events count;  second : of each body, whether second ones do
    picks : beams for a line of sight;  fewer : of each body, for those that share what they gather
    shares : (pixels,) body of which the camera's lines of sight share it, or -1
    beyond : of each body (L,) m, distance of a mirror outside of its boundary; inf where there is none
    """

    beams: list
    later: bool
    second: list
    picks: int
    fewer: list
    shares: np.ndarray
    beyond: list

    def __call__(self, transport, paths, number, sums):
        """Adds to sums what beams bring to lines of sight in body `number` that come from a surface."""
        body, beams = transport.bodies[number], self.beams[number]
        rows, lines = sights(paths)
        if not len(rows):
            return
        order = by_place(lines.origin, body.vertices)
        rows, lines = rows[order], lines.of(order)
        around, sigma = np.empty(len(rows) + 1, np.int64), body.medium.sigma_t
        groups = _choice.grouped(lines.origin, lines.direction, lines.far, float(sigma.min()), around)
        picks = np.where(lines.seen & (self.shares[lines.pixel] == number), self.fewer[number], self.picks)
        normals = facing(transport, lines) if np.isfinite(self.beyond[number]).any() else np.empty((0, 3))
        sight = _gather.Lines(lines.origin, lines.direction, lines.far, normals, lines.states, picks, around,
                              np.zeros((3, *lines.throughput.shape)))
        for w, (tables, cosine, beyond) in enumerate(zip(body.tables, mean_cosines(body.medium), self.beyond[number])):
            wave = _gather.Wave(w, cosine, *tables, self.later, self.second[number], beyond)
            clusters = _choice.clusters_of(sigma[w], w, beams)
            run(_gather.gather, groups, transport.geometry, body.medium, wave, beams, clusters, sight, block=16)
        # the numbers with which beams were drawn serve nothing else
        states = paths.states[rows]
        wavefront.branch(states)
        paths.states[rows] = states
        later, second, beyond = (values * lines.throughput @ transport.colours.to_rgb.T for values in sight.brought)
        sums.add_gathered(lines, later)
        sums.add_of_beams(lines, second, 2)
        sums.add_of_beams(lines, beyond, 3)


def sights(paths):
    """Lines of sight of paths that come from a surface, as `thinned`: their rows and themselves."""
    return thinned(paths, paths.events == 0)


def by_place(points, vertices):
    """Order (n,) of points (n, 3) in which neighbours are near each other: along a Morton curve through the box of a mesh."""
    low, size = vertices.min(axis=0), np.ptp(vertices, axis=0).max()
    cell = np.clip((points - low) / size * 1024, 0, 1023).astype(np.int64)
    code = np.zeros(len(points), np.int64)
    for bit in range(10):
        for axis in range(3):
            code |= (cell[:, axis] >> bit & 1) << 3 * bit + axis
    return np.argsort(code, kind="stable")
