"""Surfaces of a Mitsuba scene as arrays: meshes, boxes, and what their boundaries do to light."""

import math
from typing import NamedTuple

import mitsuba as mi
import numpy as np

from renderers.mitsuba import shading


class Shape(NamedTuple):
    """A surface of the scene.

    name : its id
    vertices, faces : (V, 3) m and (F, 3) of a mesh, as the file has them; None of another shape
    box : (2, 3) m, corners of the box around it
    index : refractive index behind it over that before it, of smooth and rough dielectrics; 1 where there is no boundary
        (`null`); None of other surfaces
    smooth : whether that is no rough dielectric
    specular : whether it sends light on in single directions, alone (mirrors, smooth panes) or beside others (`plastic`)
    passed : whether light goes straight through it, or through parts of it: it is `null`, a mask or a thin pane
    normals : (V, 3) unit, from which light takes those of the mesh; None where these are its triangles'
    flipped : whether normals are turned against the order of the faces
    sphere : whether it is a sphere, of which there is nothing within
    """

    name: str
    vertices: np.ndarray | None
    faces: np.ndarray | None
    box: np.ndarray
    index: float | None
    smooth: bool
    normals: np.ndarray | None = None
    specular: bool = False
    flipped: bool = False
    sphere: bool = False
    passed: bool = False


def of_scene(scene, unit) -> list[Shape]:
    """All surfaces of a `mitsuba.Scene`; unit : m, length of 1 in it."""
    return _of(scene.shapes(), unit)


def grouped(scene, unit) -> list[Shape]:
    """Surfaces in the groups of instances, as they stand there; the BSDF of an instance says nothing."""
    nodes = mi.traverse(scene).hierarchy.items()
    return _of([node for node, (parent, _) in nodes if isinstance(node, mi.Shape) and node.class_name() != "Instance"
                and isinstance(parent, mi.Shape)], unit)


def without_nothing(scene, filled):
    """A `mitsuba.Scene` without shapes that have no boundary (`null`) and no light, and that no material of names `filled` fills:
    they are nothing, and light samples would end at them.  The same scene where there are none, or instances, whose groups no
    other scene can take over."""
    shapes = scene.shapes()
    if not filled <= {None, *(shape.id() for shape in shapes)}:
        return scene  # an entry names none of them: the message about that lists all
    kept = [shape for shape in shapes if shape.is_emitter() or shape.id() in filled or not is_null(shape.bsdf())]
    if len(kept) == len(shapes) or any(shape.class_name() == "Instance" for shape in shapes):
        return scene
    things = [*scene.sensors(), *kept, *(light for light in scene.emitters() if light.get_shape() is None)]
    names = [thing.id() for thing in things]
    parts = {f"kept_{number}": thing for number, thing in enumerate(things)}
    smaller = mi.load_dict({"type": "scene"} | parts, parallel=False, optimize=False)
    for thing, name in zip(things, names, strict=True):  # which loading has changed
        thing.set_id(name)
    return smaller


def is_null(bsdf) -> bool:
    """Whether a BSDF is no boundary at all; thin panes and masks have parameters."""
    return mi.has_flag(bsdf.flags(), mi.BSDFFlags.Null) and not len(mi.traverse(bsdf).keys())


def _of(listed, unit):
    shapes = []
    for shape in listed:
        vertices = faces = normals = None
        if shape.is_mesh():
            vertices = unit * np.array(shape.vertex_positions_buffer(), float).reshape(-1, 3)
            faces = np.array(shape.faces_buffer(), np.int64).reshape(-1, 3)
            if shape.has_vertex_normals() and not shape.has_face_normals():
                normals = np.array(shape.vertex_normals_buffer(), float).reshape(-1, 3)
        box = shape.bbox()
        box = unit * np.array([box.min, box.max], float).reshape(2, 3)
        kinds, bsdf, flags = mi.BSDFFlags, shape.bsdf(), shape.bsdf().flags()
        rough, null, mirrors, refracts = (mi.has_flag(flags, kind) for kind in (
            kinds.GlossyTransmission, kinds.Null, kinds.DeltaReflection, kinds.DeltaTransmission))
        shapes.append(Shape(shape.id(), vertices, faces, box, _index(bsdf), not rough, normals, mirrors or refracts,
                            shape.has_flipped_normals(), is_sphere(shape), null))
    return shapes


def leaning(shape, angle) -> float:
    """Share of the area of a mesh in triangles from which normals at a corner lean by more than an angle, rad."""
    if shape.normals is None:
        return 0.0
    corners = shape.vertices[shape.faces]
    flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(flat, axis=1)
    cosine = np.abs(np.einsum("fkc,fc->fk", shape.normals[shape.faces], flat)).min(axis=1)
    return float(area[cosine < math.cos(angle) * area].sum() / area.sum())


def inside_out(shape) -> bool:
    """Whether light from outside of a closed mesh sees its back: its own normals point inward, or those of its faces if it has
    none, as where a `to_world` mirrors them."""
    a, b, c = (shape.vertices[shape.faces[:, k]] - shape.vertices.mean(axis=0) for k in range(3))
    flat = np.cross(b - a, c - a)
    behind = float(np.sum(a * flat)) < 0
    if shape.normals is not None:
        behind ^= float(np.einsum("fkc,fc->", shape.normals[shape.faces], flat)) < 0
    return behind ^ shape.flipped


def lying_on(shape, surface, unit) -> float:
    """Share of the area of a mesh that lies on another, so near that a ray which leaves one of them misses the other.

    shape, surface : `Shape` with vertices and faces;  unit : m, length of 1 in the scene
    """
    corners = shape.vertices[shape.faces] / unit
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(normals, axis=1)
    normals /= np.maximum(area, np.finfo(float).tiny)[:, None]
    points = corners.mean(axis=1)
    reach = mi.math.RayEpsilon * (1 + np.abs(points).max(axis=1))  # as far from a surface Mitsuba's rays begin anew
    ray = mi.Ray3f(*(mi.Vector3f(*shading.columns(rows)) for rows in (points + reach[:, None] * normals, -normals)))
    ray.maxt = shading.rows(2 * reach)
    return float(area[np.array(mesh_scene(surface.vertices, surface.faces, unit).ray_test(ray), bool)].sum() / area.sum())


def mesh(name, vertices, faces, bsdf=None):
    """Mitsuba's mesh of vertices (V, 3), faces (F, 3) and a BSDF of Mitsuba's; None: its usual one."""
    properties = mi.Properties()
    if bsdf is not None:
        properties["mesh_bsdf"] = bsdf
    result = mi.Mesh(name, len(vertices), len(faces), props=properties)
    values = mi.traverse(result)
    values["vertex_positions"], values["faces"] = vertices.astype(np.float32).ravel(), faces.astype(np.uint32).ravel()
    values.update()
    return result


def mesh_scene(vertices, faces, unit):
    """A Mitsuba scene of nothing but a mesh of vertices (V, 3) m and faces (F, 3); unit : m, length of 1 in it."""
    return mi.load_dict({"type": "scene", "mesh": mesh("mesh", np.asarray(vertices) / unit, np.asarray(faces))})


def is_sphere(shape) -> bool:
    """Whether a shape of Mitsuba's is a sphere."""
    return shape.class_name() == "Sphere"


def encloses(sphere, box) -> bool:
    """Whether a box is inside of a sphere and does not touch it; both by their corners (2, 3) m."""
    middle, radius = sphere.mean(axis=0), float(np.ptp(sphere, axis=0).min()) / 2
    return float(np.linalg.norm(np.abs(box - middle).max(axis=0))) < (1 - 1e-5) * radius


def index_fault(shape: str, index: float | None, bsdf: float) -> str:
    """What is wrong with the index that a scene says of a shape whose BSDF has `bsdf`; "" where it is that, or none is said."""
    if index is None or abs(index - bsdf) <= 1e-3 * index:
        return ""
    return f"found {index:g}, and the BSDF of {shape} has {bsdf:g}; the same would do"


def _index(bsdf):
    """Of refraction, as `Shape.index` says."""
    flags, values = bsdf.flags(), mi.traverse(bsdf)
    if mi.has_flag(flags, mi.BSDFFlags.Null):
        return 1.0 if is_null(bsdf) else None
    through = any(mi.has_flag(flags, flag) for flag in (mi.BSDFFlags.DeltaTransmission, mi.BSDFFlags.GlossyTransmission))
    return float(np.array(values["eta"]).ravel()[0]) if through and "eta" in values else None
