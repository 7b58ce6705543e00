"""Triangles out of mesh files: stl, ply, obj and off, text and binary.

Only positions and polygons are read; polygons become fans.  Counts in headers are compared with the length of the file before
anything is allocated, nothing else is opened, and whatever is wrong is said with its line or element.

Why not trimesh's readers (`python benchmarks/meshes.py read hostile`, docs/grain-shapes.md): they refuse binary ply files with
polygons of several sizes, read relative indices of obj files wrongly and 0 as 1, and take 3 GB for 16 MiB of empty lines and
minutes for as many empty solids of a text stl file.
"""

import re
from array import array

import numpy as np

from bakery.physics.shapes.limits import BYTES, KINDS
from bakery.physics.shapes.quality import FACES

CORNERS = 1000  # of a polygon
_LINE = 1 << 16  # bytes
_HEADER = 1 << 16
_BLANK = re.compile(rb"\s*")


def triangles(data: bytes, kind: str):
    """Vertices and triangles of a mesh file, as they stand there.

    Parameters
    ----------
    data : content of the file, up to 256 MiB
    kind : "ply", "obj", "stl" or "off"

    Returns
    -------
    vertices : (V, 3) float64
    faces : (F, 3) int32, at most two million; indices are not yet compared with V

    Raises
    ------
    ValueError : what is wrong, and in which line or element

    Notes
    -----
    stl holds a vertex for each corner of each triangle: merging them is `mending.mended`'s work.
    """
    if kind not in KINDS:
        raise ValueError(f"meshes are {', '.join(KINDS[:-1])} or {KINDS[-1]} files, not {kind!r}")
    if len(data) > BYTES:
        raise ValueError(f"{len(data) / 2**20:.0f} MiB; a mesh file has at most {BYTES >> 20} MiB")
    if not data.strip():
        raise ValueError("the file is empty")
    with np.errstate(all="ignore"):  # numbers that are none are reported later, with their place
        vertices, faces = {"ply": _ply, "obj": _obj, "stl": _stl, "off": _off}[kind](data)
    if not len(faces):
        raise ValueError(f"no triangles in this {kind} file")
    return np.ascontiguousarray(vertices, np.float64), np.ascontiguousarray(faces, np.int32)


class _Text:
    """Lines of a text file with their numbers, none of them longer than 64 kB."""

    def __init__(self, data, start=0, number=0):
        self.data, self.at, self.number = data, start, number

    def __iter__(self):
        return self

    def __next__(self):
        if self.at >= len(self.data):
            raise StopIteration
        end = self.data.find(b"\n", self.at)
        end = len(self.data) if end < 0 else end
        self.number += 1
        if end - self.at > _LINE:
            raise self.wrong(f"longer than {_LINE >> 10} kB: not a text file of this kind")
        line = self.data[self.at:end]
        self.at = end + 1
        return line

    def words(self, noun):
        """Words of the next line that holds some, comments aside."""
        begin = _BLANK.match(self.data, self.at).end()  # over empty lines at once: a file may be nothing else
        self.number += self.data.count(b"\n", self.at, begin)
        self.at = begin
        for line in self:
            words = line.split(b"#", 1)[0].split()
            if words:
                return words
        raise ValueError(f"the file ends after line {self.number}, before {noun}")

    def wrong(self, text):
        return ValueError(f"line {self.number}: {text}")

    def floats(self, words, noun="a vertex"):
        try:
            if len(words) < 3:
                raise ValueError
            return float(words[0]), float(words[1]), float(words[2])
        except ValueError:
            raise self.wrong(f"three numbers expected for {noun}, found {_shown(words)}") from None

    def indices(self, words, noun="corners of a polygon"):
        try:
            return [int(word) for word in words]
        except ValueError:
            raise self.wrong(f"whole numbers expected for the {noun}, found {_shown(words)}") from None


class _Faces:
    """Polygons as fans of triangles."""

    def __init__(self):
        self.data, self.polygons = array("i"), 0

    def add(self, corners, where):
        if not 3 <= len(corners) <= CORNERS:
            raise ValueError(f"{where}: a polygon of {len(corners)} corners; it takes 3 to {CORNERS}")
        if max(corners) >= 1 << 31 or min(corners) < 0:
            raise ValueError(f"{where}: no vertex has the index {max(corners) if min(corners) >= 0 else min(corners)}")
        for i in range(1, len(corners) - 1):
            self.data.extend((corners[0], corners[i], corners[i + 1]))
        self.polygons += 1
        _few(len(self.data) // 3)

    def array(self):
        return np.array(self.data, np.int32).reshape(-1, 3)


def _few(count, noun="triangles"):
    limit = FACES[1] if noun == "triangles" else 3 * FACES[1]
    if count > limit:
        raise ValueError(f"{count:,} {noun}; at most {limit:,} (simplify the mesh first)")


def _stl(data):
    if len(data) >= 84:
        count = int.from_bytes(data[80:84], "little")
        if len(data) == 84 + 50 * count:
            _few(count)
            record = np.dtype([("normal", "<f4", 3), ("corner", "<f4", (3, 3)), ("spare", "<u2")])
            corner = np.frombuffer(data, record, count, 84)["corner"].astype(float)
            return corner.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3)
    if not data[:512].lstrip().startswith(b"solid") or b"\0" in data[:512]:
        announced = f"its header tells of {count:,} triangles, which take {84 + 50 * count:,} bytes" \
            if len(data) >= 84 else "no header"
        raise ValueError(f"neither text that begins with solid nor whole binary: {announced}; the file has {len(data):,}")
    text, corner, open_facet, ended = _Text(data), array("d"), 0, False
    for line in text:
        words = line.split(None, 4)
        word = words[0].lower() if words else b""
        if word == b"vertex":
            corner.extend(text.floats(words[1:]))
            open_facet += 1
            _few(len(corner) // 9)
        elif word == b"endloop":
            if open_facet != 3:
                raise text.wrong(f"a triangle of {open_facet} vertices")
            open_facet = 0
        ended = word == b"endsolid" or (ended and not word)
    if open_facet or not ended:
        raise ValueError(f"the file ends in line {text.number} without endsolid: cut short?")
    return np.array(corner).reshape(-1, 3), np.arange(len(corner) // 3).reshape(-1, 3)


def _obj(data):
    text, vertex, faces = _Text(data), array("d"), _Faces()
    for line in text:
        if line.startswith(b"v ") or line.startswith(b"v\t"):
            vertex.extend(text.floats(line.split(None, 4)[1:4]))
            _few(len(vertex) // 3, "vertices")
        elif line.startswith(b"f ") or line.startswith(b"f\t"):
            if line.rstrip().endswith(b"\\"):
                raise text.wrong("lines that go on in the next are not read")
            vertices_known = len(vertex) // 3
            corners = text.indices([word.split(b"/", 1)[0] for word in line.split(b"#", 1)[0].split()[1:]])
            if any(i == 0 or i < -vertices_known for i in corners):
                bad = next(i for i in corners if i == 0 or i < -vertices_known)
                raise text.wrong(f"no vertex has the index {bad}; they count from 1, or from -1 backwards")
            faces.add([i - 1 if i > 0 else vertices_known + i for i in corners], f"line {text.number}")
        elif b"\0" in line:
            raise text.wrong("binary data; obj files are text")
    if not vertex:
        raise ValueError("no line begins with v: not an obj file")
    return np.array(vertex).reshape(-1, 3), faces.array()


def _off(data):
    text = _Text(data)
    head = text.words("its header")
    name = head.pop(0)
    # letters before OFF tell of colours, normals and textures, which follow the position
    if not name.endswith(b"OFF") or not set(name[:-3]) <= set(b"CNST") or head[:1] == [b"BINARY"]:
        raise text.wrong(f"found {_shown([name, *head])}; text off files in three dimensions begin with OFF, COFF, NOFF, STOFF …")
    head = head or text.words("the counts")
    count = text.indices(head[:3], "numbers of vertices and polygons")
    if len(count) < 2 or min(count) < 0:
        raise text.wrong(f"numbers of vertices, polygons and edges expected, found {_shown(head)}")
    _fits(6 * count[0] + 8 * count[1], len(data), f"{count[0]:,} vertices and {count[1]:,} polygons")
    _few(count[0], "vertices")
    vertex, faces = array("d"), _Faces()
    for i in range(count[0]):
        vertex.extend(text.floats(text.words(f"vertex {i} of {count[0]:,}")))
    for i in range(count[1]):
        words = text.words(f"polygon {i} of {count[1]:,}")
        number = text.indices(words[:1])[0]
        if not 0 <= number < len(words):
            raise text.wrong(f"a polygon of {number} corners that names {len(words) - 1}")
        faces.add(text.indices(words[1:number + 1]), f"line {text.number}")
    return np.array(vertex).reshape(-1, 3), faces.array()


_TYPES = {b"char": "i1", b"int8": "i1", b"uchar": "u1", b"uint8": "u1", b"short": "i2", b"int16": "i2", b"ushort": "u2",
          b"uint16": "u2", b"int": "i4", b"int32": "i4", b"uint": "u4", b"uint32": "u4", b"float": "f4", b"float32": "f4",
          b"double": "f8", b"float64": "f8"}


def _ply(data):
    if not data.startswith((b"ply\n", b"ply\r")):
        raise ValueError(f"a ply file begins with the line ply, found {_shown([data[:8]])}")
    text, order, elements = _Text(data[:_HEADER]), None, []
    for line in text:
        words = line.split()
        match words:
            case [] | [b"ply"] | [b"comment" | b"obj_info", *_]:
                continue
            case [b"end_header"]:
                break
            case [b"format", b"ascii" | b"binary_little_endian" | b"binary_big_endian" as form, *_]:
                order = {b"ascii": "", b"binary_little_endian": "<", b"binary_big_endian": ">"}[form]
            case [b"element", name, count] if count.isdigit() and len(count) < 16:
                elements.append((name, int(count), []))
            case [b"property", b"list", number, kind, name] if elements and _TYPES.get(number, "f")[0] != "f" and kind in _TYPES:
                elements[-1][2].append((name, _TYPES[kind], _TYPES[number]))
            case [b"property", kind, name] if elements and kind in _TYPES:
                elements[-1][2].append((name, _TYPES[kind], ""))
            case _:
                raise text.wrong(f"not understood in the header of a ply file: {_shown(words)}")
    else:
        raise ValueError("the header of the ply file has no end_header")
    if order is None:
        raise ValueError("the header of the ply file names no format (ascii, binary_little_endian or binary_big_endian)")
    least = sum(count * sum((int((number or kind)[1]) if order else 2) for _, kind, number in properties)
                for _, count, properties in elements)
    _fits(least, len(data) - text.at + 1, ", ".join(f"{count:,} {name.decode(errors='replace')}" for name, count, _ in elements))
    body = _Text(data, text.at, text.number) if order == "" else _Binary(data, text.at, order)
    vertices, faces = None, _Faces()
    for name, count, properties in elements:
        if name == b"vertex":
            _few(count, "vertices")
            vertices = _ply_vertices(body, count, properties)
        elif name == b"face":
            faces = _ply_faces(body, count, properties)
        else:
            for _ in range(count if properties else 0):
                _ply_record(body, properties, name.decode(errors="replace"))
    if vertices is None:
        raise ValueError("the ply file has no element vertex")
    return vertices, faces if isinstance(faces, np.ndarray) else faces.array()


class _Binary:
    """The body of a binary ply file."""

    def __init__(self, data, start, order):
        self.data, self.at, self.order = data, start, order

    def take(self, dtype, count, noun):
        size = dtype.itemsize * count
        if self.at + size > len(self.data):
            raise ValueError(f"the file ends {self.at + size - len(self.data):,} bytes before the end of {noun}")
        values = np.frombuffer(self.data, dtype, count, self.at)
        self.at += size
        return values


def _ply_vertices(body, count, properties):
    names = [name for name, _, _ in properties]
    if any(number for _, _, number in properties) or not {b"x", b"y", b"z"} <= set(names) or len(set(names)) < len(names):
        raise ValueError("the vertices of the ply file need the properties x, y and z, once each, and no lists")
    if isinstance(body, _Binary):
        dtype = np.dtype([(name.decode("latin-1"), body.order + kind) for name, kind, _ in properties])
        record = body.take(dtype, count, f"the {count:,} vertices")
        return np.stack([record[axis].astype(float) for axis in "xyz"], axis=1)
    at, vertex = [names.index(axis) for axis in (b"x", b"y", b"z")], array("d")
    for i in range(count):
        words = body.words(f"vertex {i} of {count:,}")
        if len(words) < len(names):
            raise body.wrong(f"{len(names)} numbers expected for a vertex, found {_shown(words)}")
        vertex.extend(body.floats([words[k] for k in at]))
    return np.array(vertex).reshape(-1, 3)


def _ply_faces(body, count, properties):
    lists = [i for i, (name, kind, number) in enumerate(properties)
             if number and name in (b"vertex_indices", b"vertex_index") and kind[0] != "f"]
    if len(lists) != 1:
        raise ValueError("the faces of the ply file need one list of whole numbers called vertex_indices (no triangle strips)")
    if isinstance(body, _Binary) and sum(bool(number) for _, _, number in properties) == 1:
        # all triangles, as nearly every file has them: one array
        fields = []
        for i, (_, kind, number) in enumerate(properties):
            fields += [(f"n{i}", body.order + number)] if number else []
            fields += [(f"v{i}", body.order + kind, (3,) if number else ())]
        dtype, at = np.dtype(fields), body.at
        if at + dtype.itemsize * count <= len(body.data):
            _few(count)
            record = body.take(dtype, count, "faces")
            if (record[f"n{lists[0]}"] == 3).all():
                corner = record[f"v{lists[0]}"].astype(np.int64)
                bad = np.flatnonzero((corner < 0).any(axis=1) | (corner >= 1 << 31).any(axis=1))
                if bad.size:
                    raise ValueError(f"face {bad[0]}: no vertex has an index of {corner[bad[0]].tolist()}")
                return corner.astype(np.int32)
            body.at = at
    faces = _Faces()
    for i in range(count):
        faces.add(_ply_record(body, properties, f"face {i}")[lists[0]], f"face {i}")
    return faces


def _ply_record(body, properties, noun):
    """One element: for each property its number or its list of whole numbers."""
    values = []
    if isinstance(body, _Binary):
        for _, kind, number in properties:
            length = int(body.take(np.dtype(body.order + number), 1, noun)[0]) if number else 1
            if length < 0:
                raise ValueError(f"{noun}: a list of {length} entries")
            taken = body.take(np.dtype(body.order + kind), length, noun).tolist()
            values.append(taken if number else taken[0])
        return values
    words = body.words(noun)
    for _, kind, number in properties:
        length = body.indices(words[:1], "length of a list")[0] if number and words else 1
        words = words[1:] if number else words
        if not 0 <= length <= len(words):
            raise body.wrong(f"{noun}: {length} entries expected, found {len(words)}")
        taken, words = words[:length], words[length:]
        values.append((body.indices(taken) if kind[0] != "f" else taken) if number else taken)
    return values


def _fits(least, length, noun):
    if least > length:
        raise ValueError(f"the header tells of {noun}, at least {least:,} bytes; only {length:,} follow")


def _shown(words):
    text = b" ".join(words).decode(errors="replace")
    return repr(text if len(text) <= 40 else text[:40] + "…")
