"""Meshes and spheres as PLY files, which every 3D program reads."""

from collections.abc import Iterable, Mapping

import numpy as np


def mesh(vertices, faces, comments: Iterable[str] = (), single=False, normals=None) -> bytes:
    """A binary file of vertices (V, 3), with normals (V, 3) if not None, and triangles (F, 3); coordinates as doubles, or as
    floats."""
    real, form = ("float", "<f4") if single else ("double", "<f8")
    names = ["x", "y", "z"]
    if normals is not None:
        names, vertices = [*names, "nx", "ny", "nz"], np.concatenate([vertices, normals], axis=1)
    head = _head("binary_little_endian", comments, len(vertices), names, real)
    head += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header", ""]
    rows = np.empty(len(faces), np.dtype([("count", "u1"), ("corner", "<i4", 3)]))
    rows["count"], rows["corner"] = 3, faces
    return "\n".join(head).encode() + np.ascontiguousarray(vertices, form).tobytes() + rows.tobytes()


def points(properties: Mapping[str, np.ndarray], comments: Iterable[str] = ()) -> str:
    """A text file of points with properties (N,) such as x, y, z and radius, with all their digits."""
    rows = np.column_stack(list(properties.values())).astype(float).tolist()
    head = _head("ascii", comments, len(rows), properties, "double")
    return "\n".join([*head, "end_header", *(" ".join(map(repr, row)) for row in rows), ""])


def _head(form, comments, count, properties, real) -> list[str]:
    return ["ply", f"format {form} 1.0", *(f"comment {line}" for line in comments), f"element vertex {count}",
            *(f"property {real} {name}" for name in properties)]
