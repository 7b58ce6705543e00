"""Entries that are surfaces: shapes of the Mitsuba scene that get the plugin `bakedbsdf`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from renderers.materials.bodies import far as spreading
from renderers.scene.entries import declared, is_surface


class Placed(NamedTuple):
    """number : of the entry;  reasons : sentences"""

    number: int
    reasons: tuple[str, ...]


def put(scene, world, assets) -> dict[int, Placed]:
    """Gives their BSDF to the shapes of a world that are surfaces, by the numbers of their entries.

    Raises UsageError, AssetError where there is no such shape, or the asset has no stage `surface` or no such layer.
    """
    placed = {}
    for number, (entry, asset) in enumerate(zip(scene.values.materials, assets, strict=True)):
        if is_surface(entry.kind, entry.method):
            placed[number] = _put(scene, world, asset, number)
    return placed


def _put(scene, world, asset, number) -> Placed:
    import mitsuba as mi

    from renderers.mitsuba import layers

    entry, key = scene.values.materials[number], f"materials[{number}]"
    shapes = [shape for shape in world.scene.shapes() if shape.id() == entry.where.shape]
    if len(shapes) != 1:
        names = ", ".join(sorted(shape.id() for shape in world.scene.shapes())) or "none"
        raise scene.wrong(f"{key}.where.shape", f"found {len(shapes)} shapes of the id {entry.where.shape}; it has {names}")
    _refuse_without(scene, asset, number)
    layer = layers.load(str(asset.path), entry.layer or 0)
    shapes[0].set_bsdf(mi.load_dict({"type": "bakedbsdf", "filename": str(asset.path), "layer": entry.layer or 0}))
    stated = declared(entry.kind)[entry.method].leaves_out
    box = shapes[0].bbox()
    size = world.unit * float(np.max(np.array(box.max) - np.array(box.min)))
    reasons = [f"{key}: {stated}", f"{key}: {_spread_in_words(scene, world, asset, entry.layer or 0, shapes[0], size)}",
               f"{key}: its reflectance is looked up within {100 * layer.error:.2g} %, at angles to 89.9 degrees"]
    if not layer.table.free:
        reasons.append(f"{key}: from behind it is black")
    return Placed(number, tuple(reasons))


def _refuse_without(scene, asset, number) -> None:
    if "surface" not in asset.stages:
        raise scene.wrong(f"materials[{number}].method", f"found surface, and {asset.path} has no stage surface; use a section "
                          "surface: {thickness: infinite} in its recipe, or another method")


def _spread_in_words(scene, world, asset, layer, shape, size) -> str:
    far = float(np.max(spreading.spread(asset, layer)))
    source = "by walks" if spreading.baked(asset) else "by diffusion"
    words = f"light leaves it up to {_length(far)} (root mean square, {source}) from where it came in"
    if world.camera is None:
        return words
    box = world.unit * np.array([shape.bbox().min, shape.bbox().max], float).reshape(2, 3)
    nearest = float(np.linalg.norm(np.clip(world.camera.origin, box[0], box[1]) - world.camera.origin))
    angle = float(np.sqrt(np.linalg.norm(world.camera.right) * np.linalg.norm(world.camera.down)))
    pixel = nearest * angle
    compared = (f"a pixel is {_length(pixel)} wide at the nearest of its box, and that {_length(size)}: regions of a ball as "
                f"wide would be off by {100 * spreading.OFF * far / (0.5 * size):.2g} % or less")
    verdict = "; use another method where it is near" if far > pixel else ""
    return f"{words}; {compared}{verdict}"


def _length(metres: float) -> str:
    for unit, scale in (("um", 1e-6), ("mm", 1e-3)):
        if metres < 1e3 * scale:
            return f"{metres / scale:.2g} {unit}"
    return f"{metres:.3g} m"
