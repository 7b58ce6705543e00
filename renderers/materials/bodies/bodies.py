"""The bodies of a scene: their boundaries among the shapes of the Mitsuba scene, their media, and the triangles that rays in
them meet."""

import math
from typing import NamedTuple

import numpy as np

from bakery import kernels
from bakery.errors import UsageError
from renderers.materials.bodies import _geometry
from renderers.materials.bodies._geometry import Geometry
from renderers.materials.bodies._shells import Shells
from renderers.mitsuba.shapes import encloses, index_fault, inside_out, leaning, lying_on
from renderers.scene.budget import percent
from renderers.threads import run
from renderers.transport import solids
from renderers.transport.scattering import Scatterer, scatterer

_ROUNDING = 0.4  # light lost, times mean free paths over the distance of neighbouring numbers
# A slab whose normals lean by 55 degrees shows 0.83 of the light of an even sky, a cube 0.92, an icosahedron (37 degrees) 0.97
_LEANS, _LEANING = math.radians(40.0), 0.1  # so far, on this share of the boundary, are worth a word
_BEYOND_PRECISION = 3e-3  # share of the light lost to rounding from which on it is stated
_TOUCHING = 0.01  # of a boundary, on glass, is worth a word
_VOXELS = 64  # along the longest edge of the box around all bodies


class Body(NamedTuple):
    """A body of a translucent material.

    name : of its shape
    vertices, faces : (V, 3) m, (F, 3), closed, outward
    index : refractive index inside over that outside; 1 where there is no boundary to light
    smooth : whether Fresnel's equations are all that its boundary does to light
    medium : `Scatterer`, of the events that the tables count
    tables : of each wavelength those of points and of segments, ready for look-ups
    convex : whether no straight way between two of its points leaves it, or meets another surface
    shells : `Shells`, through which paths jump in it
    """

    name: str
    vertices: np.ndarray
    faces: np.ndarray
    index: float
    smooth: bool
    medium: Scatterer
    tables: list
    convex: bool
    shells: Shells

    @property
    def matched(self):
        """Whether light crosses the boundary as if there were none."""
        return self.index == 1.0


def solid_shape(shapes, name, index, wrong):
    """The shape of a name, its vertices and faces those of a closed mesh, wound outward.

    shapes : of `renderers.mitsuba.world.World.shapes`
    index : refractive index that a scene says, or None
    wrong : function of (key of the entry, message) -> the exception to raise where no medium can fill it
    """
    named = [shape for shape in shapes if shape.name == name]
    if len(named) != 1:
        names = ", ".join(sorted(filter(None, (shape.name for shape in shapes)))) or "none"
        raise wrong("where.shape", f"found {name!r}; expected the id of a shape of the Mitsuba scene: {names}")
    shape = named[0]
    if shape.faces is None:
        raise wrong("where.shape", f"{name} is no mesh; a closed mesh would do")
    try:
        vertices, faces = kernels.solid(shape.vertices, shape.faces)
    except ValueError as fault:
        raise wrong("where.shape", f"{name} is no closed mesh: {fault}") from None
    if shape.index is None:
        raise wrong("where.shape", f"the BSDF of {name} lets no light in; dielectric, roughdielectric or null would do")
    if fault := index_fault(name, index, shape.index):
        raise wrong("boundary.index", fault)
    if shape.index != 1.0 and inside_out(shape):
        raise wrong("where.shape", f"{name} is inside out: its normals point inward, so that its BSDF takes the outside for the "
                    'inside; <boolean name="flip_normals" value="true"/> in the Mitsuba file turns it')
    return shape._replace(vertices=vertices, faces=faces)


def refusal(shapes, name, index) -> str:
    """Why no medium can fill a shape; "" where one can.  Parameters as those of `solid_shape`."""
    try:
        solid_shape(shapes, name, index, lambda key, message: UsageError(message))
    except UsageError as fault:
        return str(fault)
    return ""


def flaws(world, bodies):
    """Sentences on meshes by which boundaries send light where it should not go."""
    return leans(world, bodies) + lies_on_glass(world, bodies)


def leans(world, bodies):
    """Sentences on bodies, and on glass around them, that refract by normals that are means over sharp edges."""
    straight = {body.name for body in bodies if body.matched}
    shares = {shape.name: leaning(shape, _LEANS) for shape in world.shapes()
              if shape.faces is not None and shape.index not in (None, 1.0) and shape.name not in straight}
    return [f"normals on {percent(share)} of {name} lean by more than {math.degrees(_LEANS):.0f} degrees from its triangles: "
            "light is lost there, or leaves where it should not; use face_normals in the Mitsuba file, or normals in the mesh "
            "that keep edges sharp" for name, share in shares.items() if share > _LEANING]


def lies_on_glass(world, bodies):
    """Sentences on bodies that lie on glass which is no body: rays that meet one of both surfaces miss the other there."""
    shapes, names = world.shapes(), {body.name for body in bodies}
    glass = [shape for shape in shapes if shape.index is not None and shape.faces is not None and shape.name not in names]
    shares = {(shape.name, pane.name): lying_on(shape, pane, world.unit)
              for shape in shapes if shape.name in names for pane in glass if _near(shape.box, pane.box)}
    return [f"{percent(share)} of the boundary of {name} lie on {pane}: light that meets one of the surfaces misses the other; "
            f"leave a gap, or make {pane} solid where {name} is, and boundary.index that of {name} over that of {pane}"
            for (name, pane), share in shares.items() if share > _TOUCHING]


def _near(first, second):
    beyond = 1e-3 * (np.ptp(first, axis=0).max() + np.ptp(second, axis=0).max())
    return bool((first[0] <= second[1] + beyond).all() and (second[0] <= first[1] + beyond).all())


def rounding(body) -> float:
    """Share of its light that a body loses where positions are held in single precision, as in the loop of Dr.Jit: about.

    It grows as the distance of two neighbouring numbers over the mean free path.  Measured with cubes of albedo 0.5 to 0.99 in
    light from all around, 1 km to 500 km from the origin: 0.1 % where that is 1/400, 0.4 % at 1/100, 3 % at 1/13, 10 % at 1/3.
    """
    return min(_ROUNDING * float(np.spacing(np.float32(np.abs(body.vertices).max())) * np.max(body.medium.sigma_t)), 1.0)


def rounded(bodies):
    """Sentences on bodies that lose much of their light where positions are in single precision."""
    return [f"{body.name} reaches {np.abs(body.vertices).max():.3g} m from the origin, where single precision holds a mean free "
            f"path of {1 / np.max(body.medium.sigma_t):.3g} m too coarsely: some {percent(rounding(body))} of its light is lost; "
            "nearer to the origin, or smaller, it would not be" for body in bodies if rounding(body) > _BEYOND_PRECISION]


def has_tables(asset) -> bool:
    """Whether an asset has the stage multiple."""
    return "multiple" in asset.stages


def medium_of(asset) -> Scatterer:
    """The asset's medium, without the forward peak of its phase function where its tables do without it."""
    events = asset.multiple
    return scatterer(np.asarray(asset.medium.sigma_t) * np.asarray(events.extinction), np.asarray(events.albedo),
                     np.asarray(asset.medium.theta, float), np.asarray(events["phase"], float))


def laid_out(world, bodies, wrong) -> tuple[list[Body], Geometry]:
    """Bodies, with `convex` as the scene has it, and the layout for their rays, which pilots and picture share.

    bodies : list of `Body`
    wrong : function of (number of a body, what of it, message) -> the exception to raise where a surface that is no mesh reaches
        into one
    """
    convex, geometry = world.once(("layout", *(body.name for body in bodies)), lambda: _layout(world, bodies, wrong))
    return [body._replace(convex=flag) for body, flag in zip(bodies, convex, strict=True)], geometry


def _layout(world, bodies, wrong) -> tuple[list[bool], Geometry]:
    """Of each body whether it is convex and nothing is near, and the layout."""
    boxes = [np.array([body.vertices.min(axis=0), body.vertices.max(axis=0)]) for body in bodies]
    names = [body.name for body in bodies]
    corners = [body.vertices[body.faces] for body in bodies]
    owners = [np.full(len(body.faces), number) for number, body in enumerate(bodies)]
    crowded = np.zeros(len(bodies), bool)
    for shape in world.shapes():
        if shape.name in names:
            continue
        triangles = None if shape.faces is None else shape.vertices[shape.faces]
        for number, box in enumerate(boxes):
            if not np.all((shape.box[0] <= box[1]) & (shape.box[1] >= box[0])) or shape.sphere and encloses(shape.box, box):
                continue
            if triangles is None:
                if _reaches(shape.box, bodies[number]):
                    raise wrong(number, "where.shape",
                                f"{shape.name} reaches into {names[number]} and is no mesh; a mesh would do")
                continue
            near = np.all((triangles.min(axis=1) <= box[1]) & (triangles.max(axis=1) >= box[0]), axis=1)
            crowded[number] |= bool(near.any())
            corners.append(triangles[near])
            owners.append(np.full(int(near.sum()), -1))
    for number, box in enumerate(boxes):
        crowded[number] |= any(np.all((other_box[0] <= box[1]) & (other_box[1] >= box[0]))
                               for position, other_box in enumerate(boxes) if position != number)
    corners, owners = np.concatenate(corners), np.concatenate(owners)
    convex = [not full and _is_convex(body.vertices, body.faces) for body, full in zip(bodies, crowded)]
    return convex, _laid_in_voxels(corners, owners, np.concatenate([body.vertices for body in bodies]))


def _reaches(box, body):
    """Whether a box, less the rounding of single precision, reaches into a body."""
    low, high = box + 1e-5 * float(np.ptp(body.vertices, axis=0).max()) * np.array([[1.0], [-1.0]])
    if not np.all(low < high):
        return False
    reached, vertices = np.zeros((1, 1, 1), np.uint8), np.ascontiguousarray(body.vertices, float)
    kernels.mark_voxels(reached, low, high - low, vertices, body.faces.astype(np.int64), 0.0, np.uint8(1))
    return bool(reached.any()) or holds(body, (low + high) / 2)


def holds(body, point):
    """Whether a point (3,) is in a body."""
    return solids.holds(body.vertices, body.faces, point)


def _laid_in_voxels(corners, owners, vertices):
    low, high = corners.reshape(-1, 3).min(axis=0), corners.reshape(-1, 3).max(axis=0)
    centre, scale = (low + high) / 2, float(np.linalg.norm(high - low)) / 2 * (1 + 1e-9)
    points = (corners.reshape(-1, 3) - centre) / scale
    faces = np.arange(3 * len(corners)).reshape(-1, 3)
    nodes, children, blocks, names = kernels.triangle_tree(points, faces)
    owner = np.full(len(names), -1, np.int64)
    owner[names >= 0] = owners[names[names >= 0]]
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    size = float((high - low).max())
    count = np.maximum(1, np.ceil(_VOXELS * (high - low) / size)).astype(int)
    edge = np.maximum(high - low, 1e-6 * size) / count
    geometry = Geometry(nodes, children, blocks, centre, scale, owner, low, edge, np.empty(count, np.float32))
    run(_geometry.measure, geometry.clear.size, geometry)
    return geometry


def _is_convex(vertices, faces, share=1e-4):
    """Whether no vertex lies outside of the plane of a face by more than a share of the mesh's size."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    size = float(np.ptp(vertices, axis=0).max())
    level = np.einsum("fk,fk->f", normal, a)
    for begin in range(0, len(faces), 1024):
        rows = slice(begin, begin + 1024)
        if np.any(vertices @ normal[rows].T - level[rows] > share * size):
            return False
    return True
