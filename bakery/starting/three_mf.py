"""Triangles of a 3MF file: a ZIP archive with a model in XML, which says its unit.

Source: 3MF Core Specification 1.3, chapters 3 and 4.  Read are the meshes of the items to build, with their transforms.
"""

import io
import zipfile
from xml.etree import ElementTree

import numpy as np

from bakery.physics.shapes.limits import BYTES

_CORE = "{http://schemas.microsoft.com/3dmanufacturing/core/2015/02}"
_UNITS = {"micron": "um", "millimeter": "mm", "centimeter": "cm", "meter": "m", "inch": "in", "foot": "ft"}


def triangles(data: bytes):
    """Vertices (V, 3), triangles (F, 3), and the unit: um, mm, cm, m, in or ft.

    Raises ValueError, in words, where it is no such file.
    """
    root = _model(data)
    meshes = {item.get("id"): item.find(f"{_CORE}mesh") for item in root.iterfind(f"{_CORE}resources/{_CORE}object")}
    vertices, faces, count = [], [], 0
    for item in root.iterfind(f"{_CORE}build/{_CORE}item"):
        mesh = meshes.get(item.get("objectid"))
        if mesh is None:
            raise ValueError("an item of this 3mf file is no mesh but an assembly; expected one mesh")
        corners = _numbers(mesh, "vertices/vertex", "xyz", float)
        transform = _transform(item.get("transform"))
        vertices.append(corners @ transform[:3] + transform[3])
        faces.append(_numbers(mesh, "triangles/triangle", ("v1", "v2", "v3"), int) + count)
        count += len(corners)
    if not count or not sum(map(len, faces)):
        raise ValueError("no triangles in this 3mf file")
    unit = root.get("unit", "millimeter")
    if unit not in _UNITS:
        raise ValueError(f"unit is {unit[:40]!r}; 3mf has {', '.join(_UNITS)}")
    return np.concatenate(vertices), np.concatenate(faces), _UNITS[unit]


def _model(data):
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            models = [member for member in archive.infolist() if member.filename.lower().endswith(".model")]
            if not models:
                raise ValueError("a 3mf file without a model")
            if models[0].file_size > BYTES:
                raise ValueError(f"a model of {models[0].file_size / 2**20:.0f} MiB; expected at most {BYTES >> 20} MiB")
            text = archive.read(models[0])
        if b"<!DOCTYPE" in text:  # entities that stand for each other take all memory
            raise ValueError("the model declares a document type, which no 3mf file needs")
        return ElementTree.fromstring(text)
    except (zipfile.BadZipFile, ElementTree.ParseError, NotImplementedError, RuntimeError, EOFError) as fault:
        raise ValueError(f"no 3mf file: {fault}") from None


def _numbers(mesh, path, names, kind):
    first, second = path.split("/")
    try:
        rows = [[kind(element.attrib[name]) for name in names]
                for element in mesh.iterfind(f"{_CORE}{first}/{_CORE}{second}")]
    except (KeyError, ValueError) as fault:
        raise ValueError(f"a {second} of this 3mf file has no number {fault}") from None
    return np.array(rows, kind).reshape(-1, 3)


def _transform(text):
    """(4, 3): rows that a row vector is multiplied with; the unit where there is none."""
    try:
        rows = np.array(text.split(), float) if text else np.eye(4)[:, :3].ravel()
        return rows.reshape(4, 3)
    except ValueError:
        raise ValueError(f"transform is {text[:60]!r}; expected twelve numbers") from None
