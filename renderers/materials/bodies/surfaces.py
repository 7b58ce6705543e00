"""Surfaces ahead of paths: the boundary of a body to which light is blind is crossed here, at others Mitsuba turns paths."""

import numpy as np

from renderers.materials.bodies import _geometry
from renderers.materials.bodies.paths import starting
from renderers.mitsuba.shading import LOBE, selected
from renderers.threads import run
from renderers.transport import steps, wavefront
from renderers.transport.paths import joined

_SPLITS, _WORTH = 4, 0.01  # surfaces at which paths go both ways, and the weight above which they do
_FAR = 64  # bounces after which surfaces end paths
_CERTAIN = 1e20  # 1/sr, of a direction that is drawn for sure, as single precision has room for


def located(geometry, paths):
    """Bodies (n,) in which paths are; finds the first triangle ahead of each."""
    body = np.empty(paths.count, np.int64)
    run(_geometry.locate, paths.count, geometry, paths.origin, paths.direction, paths.start, body, paths.far, paths.triangle)
    return body


def facing(transport, paths):
    """Outward normals (n, 3) of the boundary where paths have come into a body."""
    normals = np.empty(paths.origin.shape)
    run(_geometry.boundary_normals, len(normals), transport.geometry, paths.origin, paths.direction, normals)
    return normals


def blind(transport, paths):
    """Whether (n,) the triangle ahead of paths bounds a body, and light crosses it as if there were nothing."""
    owner = np.where(paths.triangle >= 0, transport.geometry.owner[paths.triangle], -1)
    return (owner >= 0) & transport.matched[np.maximum(owner, 0)]


def crossed(transport, paths):
    """Paths beyond boundaries to which light is blind."""
    paths.origin[:] += (paths.far + transport.off)[:, None] * paths.direction
    paths.start[:], paths.events[:] = paths.triangle, 0
    # light samples at surfaces end at any boundary, those at events do not
    paths.single[:] |= ~paths.scattered
    return paths


def at_surfaces(transport, paths, sums=None, traced=True):
    """Paths after the surface ahead: beyond boundaries to which light is blind, or turned by Mitsuba, their light added.

    sums : None: light itself goes, whose power surfaces turn
    traced : whether something else may stand before the body, as outside of all
    """
    crosses = blind(transport, paths)
    if traced:
        ways = paths.origin[crosses], paths.direction[crosses], paths.far[crosses] * (1 - 1e-4)
        crosses[crosses] = ~(transport.world.trace(*ways) < np.inf)
    if not crosses.any():
        return shaded(transport, paths, sums)
    return joined([crossed(transport, paths.of(crosses)), shaded(transport, paths.of(~crosses), sums)])


def shaded(transport, paths, sums=None):
    """Paths that Mitsuba has turned at surfaces, after their light has been added; sums : as of `at_surfaces`.

    At smooth dielectrics that the camera sees, directly or through and in others, paths of much weight go both ways.
    """
    if not paths.count:
        return paths
    numbers, power = wavefront.uniforms(paths.states, 6), sums is None
    seen = splits(paths)
    if not seen.any():
        return _turned(transport, paths, _shade(transport, paths, numbers, power), sums)
    parts = [_turned(transport, paths.of(~seen), _shade(transport, paths.of(~seen), numbers[~seen], power), sums)]
    paths, numbers = paths.of(seen), numbers[seen]
    back, on = (_shade(transport, paths, _chosen(numbers, lobe), power) for lobe in (0.0, 1.0))
    sampled = back.hit & back.delta & on.delta & (back.density > 0) & (on.density > 0) \
        & (np.abs(back.density + on.density - 1) < 1e-4)
    parts.append(_turned(transport, paths.of(~sampled), _shade(transport, paths.of(~sampled), numbers[~sampled], power), sums))
    for shading, add in ((back, sums), (on, None)):
        part = paths.of(sampled)
        part.throughput[:] *= shading.density[sampled][:, None]
        parts.append(_turned(transport, part, selected(shading, sampled), add))
    wavefront.branch(parts[-1].states)
    return joined(parts)


def splits(paths):
    """Which paths (n,) the camera sees as they are, with so much weight that both of two ways are worth going."""
    return paths.seen & (paths.bounces < _SPLITS) & (paths.throughput.max(axis=1) > _WORTH)


def _shade(transport, paths, numbers, power):
    return transport.world.shade(paths.origin, paths.direction, numbers, paths.density, paths.single, paths.drawn, power=power)


def _chosen(numbers, lobe):
    """The same numbers, but for that which chooses a lobe of a BSDF."""
    numbers = numbers.copy()
    numbers[:, LOBE] = lobe
    return numbers


def _turned(transport, paths, shading, sums):
    """Paths that go on from surfaces as Mitsuba says, after their light has been added."""
    counted = sums if sums and sums.by_paths else None
    if counted:
        shading = _less_of_beams(transport, paths, shading)
        steps.add_light(transport.colours, paths.throughput, paths.order, shading.emitted, shading.source, paths, counted)
    # from the boundary to the next surface, where `emitted` asks for the density of light samples
    paths.rival[paths.events == 0] = 0.0
    paths = steps.turned(transport.colours, paths, shading, counted)
    paths.drawn[:] = paths.origin
    paths.start[:], paths.events[:], paths.scattered[:] = -1, 0, False
    paths.seen[:] &= paths.single & (paths.order == 0)
    rivals = paths.rival > 0
    paths.density[rivals & paths.single], paths.single[rivals] = _CERTAIN, False
    return steps.thinned(steps.survivors(paths), _FAR)


def _less_of_beams(transport, paths, shading):
    """What paths have met, less the share of its light, and of that of light samples, which beams bring."""
    if not paths.rival.any():
        return shading
    light, leaving = shading.light, paths.events == 0
    # a rough boundary takes its light sample while the path is still inside
    leaves = np.flatnonzero(~leaving & (paths.rival > 0) & (light.radiance > 0).any(axis=1))
    ahead = light.direction[leaves].astype(float)
    ahead = starting(shading.point[leaves] + transport.off * ahead, ahead, 1, leaves, leaves)
    leaves = leaves[located(transport.geometry, ahead) == _geometry.OUTSIDE]
    density, radiance = np.where(light.delta, np.inf, light.density)[leaves], light.radiance.copy()
    radiance[leaves] *= _share(paths.rival[leaves], density)
    emitted = shading.emitted * _share(np.where(leaving, paths.rival, 0.0), shading.by_light)
    return shading._replace(emitted=emitted, light=light._replace(radiance=radiance))


def _share(rival, density):
    """Balance heuristic (n, 1), single precision, of paths that find lights against beams that bring the same.

    rival : (n,) sr, of `Paths`;  density : (n,) 1/sr, of light samples
    """
    joins = (rival > 0) & (density > 0)
    return np.where(joins, 1 / (1 + np.where(joins, rival, 1.0) * density), 1.0).astype(np.float32)[:, None]
