"""Ways of light from lights without extent to events in a body, through a smooth boundary that turns light.

No path finds such a light through glass, so it is looked for from the event: places on the boundary where light is refracted
towards the event.  Light that comes in through a triangle fills a tube inside of the body; tubes are entered into voxels
beforehand, and of those that may reach an event's voxel every one is looked through, for all places in its triangle.  So none of
several ways is lost (Walter, Zhao, Holzschuch and Bala, SIGGRAPH 2009, search triangles in a tree for each event; Hanika,
Droske and Fascione, EGSR 2015, walk to one place).  One of the ways is followed, drawn by what it brings.
"""

from typing import NamedTuple

import numpy as np

from renderers.materials.bodies import _refraction
from renderers.materials.bodies._cells import Cells, cells_of
from renderers.materials.bodies._refraction import Front, Joined
from renderers.threads import run
from renderers.transport.paths import Flying

_VOXELS = 64  # along the longest edge of the box around a body, at most


class Bent(NamedTuple):
    """How the light of one light without extent comes into a body.

    number : position in `World.light_names`
    front, cells : where it comes in, and which voxels light of each triangle may reach
    """

    number: int
    front: Front
    cells: Cells


def bent(world, body, shapes) -> list[Bent]:
    """`Bent` of each light without extent; none where light crosses the boundary of a body straight, or it is rough: there light
    samples find them.

    shapes : of the world, the body's among them
    """
    if body.matched or not body.smooth or not world.without_extent:
        return []
    shape = next(candidate for candidate in shapes if candidate.name == body.name)
    corners = np.ascontiguousarray(shape.vertices[shape.faces])
    if shape.normals is None:
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals = np.repeat(normals[:, None] / np.linalg.norm(normals, axis=1)[:, None, None], 3, axis=1)
    else:
        normals = shape.normals[shape.faces]
    normals = np.ascontiguousarray(normals)
    return [Bent(light.number, *_ways(corners, normals, light, body.index)) for light in world.ideal_lights()]


def _ways(corners, normals, light, index):
    """`Front` of triangles (F, 3, 3) m with normals (F, 3, 3) at their corners, and its `Cells`."""
    low, high = corners.reshape(-1, 3).min(axis=0), corners.reshape(-1, 3).max(axis=0)
    # voxels about as wide as the tubes
    edge = float((high - low).max()) / np.clip(np.sqrt(len(corners)) / 2, 1, _VOXELS)
    ahead, off_mean, spread = np.empty(corners.shape), np.empty((len(corners), 2)), np.empty(len(corners))
    front = Front(corners, normals, ahead, off_mean, light.place, light.distant, index)
    run(_refraction.directions, len(corners), front, spread)
    return front, cells_of(low, high, edge, _refraction.entered, front, spread)


def joined(transport, number, bent, paths) -> Joined:
    """One way each from events in body `number` to a light, drawn among all.

    Returns the place (n, 3) m on the boundary, the direction (n, 3) from the event to it, its distance (n,) m, and the share (n,)
    by which radiance as of `World.from_light` at the place is to be multiplied: what the boundary lets in, how it focuses light,
    and one over the probability of the choice; 0 where there is no way.
    """
    n = paths.count
    ways = Joined(np.zeros((n, 3)), np.zeros((n, 3)), np.zeros(n), np.empty(n))
    run(_refraction.join, n, transport.geometry, transport.bodies[number].medium, bent.front, bent.cells,
        paths.part(Flying), ways)
    return ways
