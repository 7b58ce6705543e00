"""Exemplar grains: closed meshes in the unit sphere from a few numbers and a seed, or from a file.

Every shape is scaled so that its smallest bounding sphere is the unit sphere.  Same numbers, same mesh.  Which grains they make,
and how good the meshes are: docs/grain-shapes.md.
"""

import inspect
from dataclasses import dataclass, replace

import numpy as np

from bakery.physics.shapes import limits, radial
from bakery.physics.shapes.bounding import onto_unit_sphere
from bakery.physics.shapes.limits import LEVELS, TRIANGLES
from bakery.physics.shapes.noise import directions, stream

_ROCK, _CRYSTAL = 11, 12  # streams of random numbers


@dataclass(frozen=True)
class Mesh:
    """A grain whose smallest bounding sphere is the unit sphere."""

    vertices: np.ndarray  # (V, 3), norms at most 1
    faces: np.ndarray  # (F, 3) int32, counterclockwise seen from outside; each edge has two
    # "sphere" where the grain is exactly the unit ball and the triangles are for pictures only: scattering by a faceted ball does
    # not converge to that of the ball
    analytic: str | None = None
    notes: tuple[str, ...] = ()  # what was mended in a file, or is not as asked for

    @property
    def volume(self) -> float:
        """Volume; that of the unit ball is 4.18879."""
        from bakery.physics.shapes.quality import volume

        return 4 / 3 * np.pi if self.analytic == "sphere" else volume(self.vertices, self.faces)

    @property
    def area(self) -> float:
        """Area of the surface."""
        from bakery.physics.shapes.quality import area

        return 4 * np.pi if self.analytic == "sphere" else area(self.vertices, self.faces)


def build(shape, triangles=LEVELS["middle"]) -> Mesh:
    """The mesh of a shape.

    shape : mapping with `type`, a name in `SHAPES`, and the keywords of that function
    triangles : wanted number, 20 to 2 million; a box has 12 whatever is wished, a file no more than it holds

    Raises ValueError : what is wrong with a number, or with the file

    >>> grain = build({"type": "box", "size": [1, 1, 1]})
    >>> len(grain.faces), round(grain.volume * 3**1.5 / 8, 12)
    (12, 1.0)
    """
    shape = dict(shape)
    kind = shape.pop("type", None)
    if kind not in SHAPES:
        raise ValueError(f"shapes are {', '.join(SHAPES)}; found {kind!r}")
    if not TRIANGLES[0] <= triangles <= TRIANGLES[1]:
        raise ValueError(f"{triangles:,} triangles; from {TRIANGLES[0]} to {TRIANGLES[1]:,} can be made")
    keys = [name for name in inspect.signature(SHAPES[kind]).parameters if name != "triangles"]
    unknown = sorted(set(shape) - set(keys))
    if unknown:
        raise ValueError(f"a {kind} has no {unknown[0]!r}; it takes {', '.join(keys) or 'nothing'}")
    if "data" in keys and "data" not in shape:
        raise ValueError("a mesh needs the content of a file")
    return SHAPES[kind](**shape, triangles=triangles)


def sphere(triangles=LEVELS["middle"]) -> Mesh:
    """The unit ball, exact; the triangles are for pictures."""
    vertices, faces = radial.icosphere(triangles)
    return replace(_scaled(vertices, faces), analytic="sphere")


def box(size=(1.0, 1.0, 1.0), triangles=12) -> Mesh:
    """A cuboid with edges in these proportions, exact: 12 triangles."""
    half = 0.5 * _three("size", size)
    corner = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float) * half
    quads = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    return _scaled(corner, np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))], np.int32))


def ellipsoid(axes=(1.0, 0.8, 0.65), triangles=LEVELS["middle"]) -> Mesh:
    """An ellipsoid, inscribed: its volume is too small by 11/F of itself for F triangles."""
    vertices, faces = radial.icosphere(triangles)
    return _scaled(vertices * _three("axes", axes), faces)


def superellipsoid(axes=(1.0, 1.0, 1.0), exponents=(0.5, 0.5), triangles=LEVELS["middle"]) -> Mesh:
    """((x/a)^(2/f) + (y/b)^(2/f))^(f/e) + (z/c)^(2/e) = 1.

    exponents : e (from pole to pole) and f (around), 0.1 to 4, or one number for both: towards 0 a box, 1 an ellipsoid, 2 an
        octahedron, above hollow

    Source: Barr, IEEE Computer Graphics and Applications 1 (1), 11 (1981).
    """
    axes = _three("axes", axes)
    exponents = np.atleast_1d(np.asarray(exponents, float))
    if exponents.shape not in ((1,), (2,)):
        raise ValueError("exponents are one or two numbers")
    e, f = (_within("exponents", x, *limits.EXPONENTS) for x in np.broadcast_to(exponents, 2))
    signs = np.array([s for s in np.ndindex(3, 3, 3) if sum(k != 1 for k in s) in (1, 3)]) - 1  # towards corners or spikes
    direction, faces = radial.sampling(triangles, corners=signs)
    x, y, z = np.abs(direction).T
    # with the largest term taken out, so that none overflows
    around = np.maximum(x, y)
    with np.errstate(invalid="ignore", divide="ignore"):
        equator = np.where(around > 0, around * ((x / around) ** (2 / f) + (y / around) ** (2 / f)) ** (f / 2), 0.0)
    most = np.maximum(equator, z)
    reach = most * ((equator / most) ** (2 / e) + (z / most) ** (2 / e)) ** (e / 2)
    return _scaled(direction / reach[:, None] * axes, faces)


def rock(seed=0, axes=(1.0, 0.8, 0.65), corners=45, sharpness=24.0, roughness=0.02, triangles=LEVELS["middle"]) -> Mesh:
    """A worn fragment: the hull of random points on an ellipsoid, with rounded edges and a rough surface.

    corners : points, 8 to 300; few give a splinter, many a pebble
    sharpness : 4 to 1000 or inf: of the edges
    roughness : 0 to 0.3: height of the largest of five octaves of noise over the radius, about
    """
    rng = stream(_whole("seed", seed, *limits.SEED), _ROCK)
    axes = _three("axes", axes)
    axes = axes / axes.max()
    points = directions(rng, _whole("corners", corners, *limits.CORNERS)) * axes
    points -= 0.5 * (points.max(axis=0) + points.min(axis=0))
    normal, distance = radial.hull_planes(points)
    for _ in range(20):  # until the origin is well inside
        if distance.min() > 0.1 * axes.min():
            break
        points -= normal[np.argmin(distance)] * (distance.min() - 0.15 * axes.min())
        normal, distance = radial.hull_planes(points)
    return _star(axes, normal, distance, sharpness, roughness, rng, 2.5, triangles)


def crystal(seed=0, habit="cube", axes=(1.0, 1.0, 1.0), chips=2, depth=0.2, sharpness=60.0, roughness=0.004,
            triangles=LEVELS["middle"]) -> Mesh:
    """A crystal with chipped corners, rounded edges and a slightly rough surface.

    habit : a name in `HABITS`: cube (salt), octahedron, hexagonal prism (ice) or sucrose
    axes : proportions, by which the perfect crystal is stretched
    chips : 0 to 30 corners cut off;  depth : 0 to 0.6, largest share of the height that one takes
    sharpness, roughness : as of `rock`
    """
    rng = stream(_whole("seed", seed, *limits.SEED), _CRYSTAL)
    axes = _three("axes", axes)
    if habit not in HABITS:
        raise ValueError(f"habits are {', '.join(HABITS)}; found {habit!r}")
    axes = axes / axes.max()
    normal, distance = HABITS[habit]()
    long = np.sqrt(((normal / axes) ** 2).sum(axis=1))
    normal, distance = radial.cut_corners(normal / axes / long[:, None], distance / long, rng,
                                          _whole("chips", chips, *limits.CHIPS), _within("depth", depth, *limits.DEPTH))
    return _star(axes, normal, distance, sharpness, roughness, rng, 3.0, triangles)


def aggregate(seed=0, arrangement="cluster", bodies=6, smallest=0.6, length=0.0, overlap=0.35, blend=0.05,
              triangles=LEVELS["middle"]) -> Mesh:
    """Balls or rods grown together: starch in flour, sintered snow.

    arrangement : cluster (each grows on one that is there, somewhere) or star (rods from the first, which is a ball, outward)
    bodies : 1 to 64
    smallest : 0.05 to 1, radius of the smallest over the largest; the first is the largest
    length : 0 to 10, of a rod's axis over its radius; 0: balls
    overlap : 0.05 to 1.5, how deep two bodies stand in each other, over the smaller radius; of a cluster
    blend : 0.01 to 0.5, width over which grooves are filled, over the largest radius; grooves finer than the triangles may be
        bridged by small handles
    """
    from bakery.physics.shapes import rods
    from bakery.physics.shapes.implicit import surface
    from bakery.physics.shapes.quality import bodies as bodies_of

    if arrangement not in limits.ARRANGEMENTS:
        raise ValueError(f"arrangements are cluster and star; found {arrangement!r}")
    grown = rods.grown(_whole("seed", seed, *limits.SEED), arrangement, _whole("bodies", bodies, *limits.BODIES),
                       _within("smallest", smallest, *limits.SMALLEST), _within("length", length, *limits.LENGTH),
                       _within("overlap", overlap, *limits.OVERLAP), _within("blend", blend, *limits.BLEND))
    vertices, faces = surface(grown.distance, *grown.box, triangles, grown.detail)
    if (pieces := int((bodies_of(vertices, faces)[1] > 0).sum())) > 1:  # cavities are negative
        raise ValueError(f"falls into {pieces} pieces at {triangles:,} triangles: take more of them, or a deeper overlap")
    return level(_scaled(vertices, faces), triangles)


def mesh(data: bytes, kind: str, triangles=LEVELS["middle"], repair=None) -> Mesh:
    """A grain from a file, checked, with at most `triangles` triangles.

    data : content of the file;  kind : "ply", "obj", "stl" or "off"
    repair : "pymeshlab" closes holes and the like before the check

    Raises ValueError : what is wrong, and where
    """
    from bakery.physics.shapes.files import triangles as read
    from bakery.physics.shapes.mending import Unsound, mended
    from bakery.physics.shapes.repair import repaired

    if repair not in (None, *limits.REPAIRS):
        raise ValueError(f"repair is {' or '.join(limits.REPAIRS)}; found {repair!r}")
    triangulated, told = read(data, kind), ()
    if repair:
        *triangulated, told = repaired(*triangulated)
    try:
        vertices, faces, notes = mended(*triangulated)
    except Unsound as fault:
        raise ValueError(f"{fault}; " + ("pymeshlab did not mend it" if repair else "`repair: pymeshlab` may mend it")) from None
    return level(replace(_scaled(vertices, faces), notes=told + notes), triangles)


def level(grain: Mesh, triangles) -> Mesh:
    """The same grain with at most about this many triangles; more where fewer would cross each other, and a note then."""
    from bakery.physics.shapes.quality import self_crossings, tree
    from bakery.physics.shapes.simplify import simplified

    wanted = triangles
    while triangles < len(grain.faces):
        vertices, faces = simplified(grain.vertices, grain.faces, triangles)
        if not len(self_crossings(tree(vertices, faces), 1)):
            notes = grain.notes
            if len(faces) > 1.01 * wanted + 1:
                notes += (f"{len(faces):,} triangles instead of {wanted:,}: fewer would not keep the shape whole",)
            return replace(_scaled(vertices, faces), notes=notes)
        triangles *= 2
    if len(grain.faces) > 1.01 * wanted + 1:
        return replace(grain, notes=grain.notes + (f"{len(grain.faces):,} triangles instead of {wanted:,}: fewer would cross",))
    return grain


def sucrose_planes():
    """Normals and distances of a sugar crystal: the forms a, c, d, p, p' and q, elongated along b as it grows from pure solution.

    Cell 10.863 x 8.705 x 7.759 A, beta 102.9 degrees (Brown & Levy, Acta Cryst. B 29, 790, 1973); the distances are chosen to
    look like the usual habit.
    """
    a, b, c, beta = 10.863, 8.705, 7.759, np.deg2rad(102.9)
    # rows: a*, b*, c*
    reciprocal = np.array([[1 / a, 0, -np.cos(beta) / (a * np.sin(beta))], [0, 1 / b, 0], [0, 0, 1 / (c * np.sin(beta))]])
    planes = {(1, 0, 0): 0.62, (0, 0, 1): 0.72, (-1, 0, 1): 0.85, (1, 1, 0): 1.0, (-1, 1, 0): 1.0, (0, 1, 1): 1.08}
    rows = [(sign * (reciprocal * np.array(index)[:, None]).sum(axis=0) * fold, height) for index, height in planes.items()
            for sign in (1, -1) for fold in (np.array([1, 1, 1]),) + ((np.array([1, -1, 1]),) if index[1] else ())]
    normal, first = np.unique(np.round(radial.unit(np.array([n for n, _ in rows])), 12), axis=0, return_index=True)
    return radial.unit(normal), np.array([height for _, height in rows])[first]


def _prism():
    turn = np.arange(6) * np.pi / 3
    side = np.stack([np.cos(turn), np.sin(turn), np.zeros(6)], axis=1)
    return np.concatenate([side, [[0, 0, 1.0], [0, 0, -1.0]]]), np.ones(8)


_CORNERS = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / np.sqrt(3)
HABITS = {"cube": lambda: (np.concatenate([np.eye(3), -np.eye(3)]), np.ones(6)), "octahedron": lambda: (_CORNERS, np.ones(8)),
          "prism": _prism, "sucrose": sucrose_planes}
SHAPES = {"sphere": sphere, "box": box, "ellipsoid": ellipsoid, "superellipsoid": superellipsoid, "rock": rock,
          "crystal": crystal, "aggregate": aggregate, "mesh": mesh}


def _star(axes, normal, distance, sharpness, roughness, rng, frequency, triangles):
    """A body between planes, with rounded edges and noise."""
    if not sharpness >= limits.SHARPNESS[0]:
        raise ValueError(f"sharpness is {limits.SHARPNESS[0]:g} or more, found {sharpness}")
    corner = radial.corners_of(normal, distance)
    reach = radial.between_planes(radial.unit(corner), normal, distance, sharpness)
    direction, faces = radial.sampling(triangles, axes, corner[np.argsort(-reach, kind="stable")])
    points = direction * radial.between_planes(direction, normal, distance, sharpness)[:, None]
    return _scaled(radial.roughened(points, _within("roughness", roughness, *limits.NOISE), rng, frequency), faces)


def _scaled(vertices, faces) -> Mesh:
    vertices = onto_unit_sphere(vertices)[0]
    faces = np.array(faces, np.int32)
    vertices.flags.writeable = faces.flags.writeable = False
    return Mesh(vertices, faces)


def _three(name, values):
    values = np.asarray(values, float)
    if values.shape != (3,) or not (np.isfinite(values).all() and (values > 0).all()):
        raise ValueError(f"{name} are three numbers above 0, found {values.tolist()}")
    if values.max() > limits.ASPECT * values.min():
        raise ValueError(f"{name} may differ by a factor of {limits.ASPECT:,.0f} at most, found {values.tolist()}")
    return values


def _within(name, value, least, most):
    if not least <= value <= most:
        raise ValueError(f"{name} is {least:g} to {most:g}, found {value}")
    return float(value)


def _whole(name, value, least, most):
    if value != int(value) or not least <= value <= most:
        raise ValueError(f"{name} is a whole number from {least} to {most}, found {value}")
    return int(value)
