"""Somebody's mesh as a solid of known size that stands on the floor."""

import math
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bakery.errors import UsageError

UNITS = {"um": 1e-6, "mm": 1e-3, "cm": 1e-2, "m": 1.0, "km": 1e3, "in": 0.0254, "ft": 0.3048}  # m
SMALLEST, LARGEST = 1e-4, 1e4  # m, longest edge of a mesh's box
_GUESSED = ("mm", "cm", "m")
_FAR = 30  # times larger or smaller than usual, beyond which no unit is guessed
_UP = {"z": np.eye(3), "y": np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])}  # turned so that z is up
# a remark such as `comment unit: mm`, `# File units = millimeters`, or UNITS=mm in the head of a binary STL
_REMARK = re.compile(rb"\bunits?\b\s*(?:are|is|[:=])?\s*\"?([a-z]+)", re.IGNORECASE)
_NAMES = (("millimet", "mm"), ("centimet", "cm"), ("micro", "um"), ("kilomet", "km"), ("meter", "m"), ("metre", "m"),
          ("inch", "in"), ("feet", "ft"), ("foot", "ft"))


@dataclass(frozen=True)
class Solid:
    """A closed mesh that stands on the plane z = 0, above and below the origin."""

    vertices: np.ndarray  # (V, 3) m
    faces: np.ndarray  # (F, 3), outward
    size: str  # why it is as large as it is, a sentence

    @property
    def extent(self) -> np.ndarray:
        """(3,) m, edges of the box around it."""
        return np.ptp(self.vertices, axis=0)

    @property
    def volume(self) -> float:
        """m^3"""
        from bakery.physics.shapes.quality import volume

        return float(volume(self.vertices, self.faces))


def solid(path: Path, usual_height: float, unit: str | None = None, height: float | None = None, up: str = "z") -> Solid:
    """The mesh of a file as a solid of some size.

    path : PLY, OBJ, STL or OFF file
    usual_height : m, of what such a mesh shows, by which a unit is guessed where neither the file nor the caller says one
    unit : one of `UNITS`, in place of the file's
    height : m, that the mesh shall have
    up : axis of the file that points up, "z" or "y"

    Raises UsageError : the file cannot be read, is no closed mesh, or of no size that can be meant
    """
    from bakery.physics.shapes.mending import mended

    vertices, faces, stated = _read(path)
    if not np.isfinite(vertices).all():
        raise UsageError(f"{path}: found coordinates that are no finite numbers; write the mesh anew without them")
    vertices = vertices @ _UP[up].T
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    longest = float((high - low).max())
    if not longest > 0:
        raise UsageError(f"{path}: found a mesh whose vertices are all in one place; give a mesh of a closed body")
    metres, sentence = _metres(path, high - low, usual_height, unit, height, stated)
    if not SMALLEST <= longest * metres <= LARGEST:
        raise UsageError(f"{path}: found a mesh {length(longest * metres)} across; expected {length(SMALLEST)} to "
                         f"{length(LARGEST)}: say its unit (--unit mm, cm, m) or its height (--height \"12 cm\")")
    foot = np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]])
    try:
        # single precision, as it is written: what is checked here is what renders
        vertices, faces, _ = mended(((vertices - foot) * metres).astype(np.float32).astype(float), faces)
    except ValueError as fault:
        raise UsageError(f"{path}: no closed mesh: {fault}") from None
    return Solid(vertices, faces, sentence)


def _read(path):
    """Vertices, triangles, and the unit that the file says, or None."""
    from bakery.physics.shapes.files import triangles
    from bakery.physics.shapes.limits import BYTES, KINDS

    kind = path.suffix.lower().lstrip(".")
    if kind not in KINDS:
        raise UsageError(f"{path}: found a name that ends in {path.suffix or 'nothing'}; expected a mesh in a "
                         "file of PLY, OBJ, STL or OFF")
    try:
        if path.stat().st_size > BYTES:
            raise UsageError(f"{path}: found {path.stat().st_size / 2**20:.0f} MiB; expected a file of at most {BYTES >> 20} MiB")
        if not path.is_file():
            raise UsageError(f"{path}: found a folder, pipe or device; expected a mesh file")
        data = path.read_bytes()
    except OSError as error:
        raise UsageError(f"{path}: cannot be read: {error.strerror}; expected a mesh file (PLY, OBJ, STL or OFF)") from None
    try:
        return *triangles(data, kind), _stated(data)
    except ValueError as fault:
        raise UsageError(f"{path}: {fault}") from None


def _stated(data: bytes) -> str | None:
    """The unit that a remark at the beginning of a file says."""
    for match in _REMARK.finditer(data[:4096].partition(b"end_header")[0]):
        word = match[1].decode("ascii").lower()
        if word in UNITS:
            return word
        for beginning, unit in _NAMES:
            if word.startswith(beginning):
                return unit
    return None


def _metres(path, edges, usual_height, unit, height, stated):
    """Length of one unit of the file in m, and the sentence that says why."""
    if unit and height:
        raise UsageError("--unit and --height: found both, but each sets the size of the mesh; give one of them")
    if height:
        if not edges[2] > 0:
            raise UsageError(f"{path}: found a flat mesh, which has no height; give a closed body, or its unit (--unit)")
        return height / edges[2], f"{length(height)} high, as asked (--height)"
    longest = float(edges.max())
    if unit or stated:
        metres = UNITS[unit or stated]
        why = "as asked (--unit)" if unit else "as the file says"
        return metres, f"{length(longest * metres)} across: one unit is 1 {unit or stated}, {why}"
    distance = {name: abs(math.log(longest * UNITS[name] / usual_height)) for name in _GUESSED}
    guess = min(distance, key=distance.get)
    if distance[guess] > math.log(_FAR):
        raise UsageError(f"{path}: found a mesh {longest:.4g} units across and no unit, and in none of {', '.join(_GUESSED)} "
                         f"is that near {length(usual_height)}; give --unit mm, cm or m, or --height \"12 cm\"")
    return UNITS[guess], (f"{length(longest * UNITS[guess])} across: GUESSED, because the file has no unit: at 1 {guess} "
                          f"a unit it is nearest to the usual {length(usual_height)} (change it with --unit or --height)")


def written(unit: str) -> str:
    """Length of one unit as scenes take it, which know neither inch nor foot."""
    return f"1 {unit}" if unit not in ("in", "ft") else f"{1e3 * UNITS[unit]:g} mm"


def length(metres: float) -> str:
    """`12 cm`: three digits, in the unit that suits."""
    for name in ("km", "m", "cm", "mm"):
        if metres >= UNITS[name] * (1 - 1e-9):
            return f"{metres / UNITS[name]:.3g} {name}"
    return f"{metres / UNITS['um']:.3g} um"
