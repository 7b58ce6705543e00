"""Meshes that entries of a scene name: what they are, and whether their unit may be meant otherwise."""

import math
import warnings
from functools import lru_cache

import numpy as np

from renderers.scene.common import LENGTH
from renderers.transport import solids

_APART = 100.0  # times, that a mesh may be larger than all else that there is of the scene; cm for m are told by it


def of_entry(scene, number):
    """Vertices (V, 3) m and triangles (F, 3) of the mesh of an entry; UsageError with the key where it is no closed mesh."""
    where = scene.values.materials[number].where
    path = scene.file(where.mesh)
    try:
        vertices, faces = _closed(path.read_bytes(), path.suffix.lstrip(".").lower())
    except ValueError as fault:
        raise scene.wrong(f"materials[{number}].where.mesh", fault) from None
    return where.unit * vertices, faces.copy()


@lru_cache(maxsize=8)  # what a scene requires, its choice and its render ask for them in turn
def _closed(data, kind):
    from bakery import kernels

    return kernels.closed_mesh(data, kind)


def world_of(scene, variant=None):
    """The `renderers.mitsuba.world.World` of a scene, errors as there; warns (`UserWarning`) of meshes as `doubts` says."""
    from renderers.mitsuba.world import World

    world = World.of(scene, variant)
    for sentence in doubts(scene, world):
        warnings.warn(sentence, stacklevel=1)  # of here, whoever asks: each once
    return world


def doubts(scene, world) -> list[str]:
    """Sentences on entries whose mesh is far larger than what is around it or smaller than a pixel, or whose grains have the
    camera among them: a scene may be meant so, but most often its unit is not, and its picture takes for ever."""
    if world.camera is None:
        return []
    around = np.vstack([world.camera.origin, *([] if world.box is None else [world.box])])
    extent, sentences = float(np.ptp(around, axis=0).max()), []
    for number, entry in enumerate(scene.materials):
        if not hasattr(getattr(entry, "where", None), "mesh"):
            continue
        vertices, faces = of_entry(scene, number)
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        size = float((high - low).max())
        amid = entry.kind == "grains" and np.all((low < world.camera.origin) & (world.camera.origin < high)) \
            and solids.holds(vertices, faces, world.camera.origin)
        away = float(np.linalg.norm(world.camera.origin - np.clip(world.camera.origin, low, high)))
        if amid or size > _APART * extent > 0 or size < away * world.camera.pixel:
            sentences.append(_doubt(scene, number, size, extent, amid))
    return sentences


def _doubt(scene, number, size, extent, amid) -> str:
    """A sentence on the mesh of an entry, size m across, in a scene extent m across; amid : the camera is in its grains."""
    where, surfaces = scene.values.materials[number].where, scene.values.scene
    key = f"materials[{number}].where.mesh"
    inside = f"the camera is in the grains of materials[{number}]: " if amid else ""
    counted = "" if "unit" in where.model_fields_set else ", as no unit: says otherwise"
    message = f"{scene.places.get(key, scene.path)}: {key}: {inside}{where.mesh} is {length(size)} across, as one unit " \
              f"of it is {length(where.unit)}{counted}"
    if not extent:
        return f"{message}; unit: beside mesh: changes that"
    units = [unit for unit in (surfaces.unit, *(10.0**power for power in LENGTH.powers.values())) if unit != where.unit]
    if surfaces.unit == where.unit:  # else most likely both files are in the same unit
        units.sort(key=lambda unit: abs(math.log(extent / (3 * size * unit / where.unit))))
    return (f"{message}; surfaces and camera span {length(extent)}. With unit: {length(units[0])} beside mesh: it is "
            f"{length(size * units[0] / where.unit)} across")


def length(metres: float) -> str:
    """`12 cm`, as scenes write it."""
    name, power = max(((name, power) for name, power in LENGTH.powers.items() if 10.0**power <= metres * (1 + 1e-9)),
                      key=lambda unit: unit[1], default=("um", -6))
    return f"{metres / 10.0**power:.3g} {name}"
