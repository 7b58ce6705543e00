"""Entries that are surfaces, or are far from the camera: shapes of the Mitsuba scene that get the plugin `bakedbsdf`."""

from typing import NamedTuple

import mitsuba as mi
import numpy as np

from renderers.materials.surface import far as spreading
from renderers.materials.surface import onset
from renderers.mitsuba import layers
from renderers.mixed.scene import chosen
from renderers.scene.entries import declared, is_surface
from renderers.scene.meshes import length
from renderers.transport.far import Far


class Changing(NamedTuple):
    """far : `renderers.transport.far.Far`, None of a body that is near with all its parts;  reasons : sentences"""

    far: Far | None
    reasons: tuple[str, ...]


def put(scene, world, assets) -> dict[int, tuple[str, ...]]:
    """Gives their BSDF to the shapes of a world that are surfaces, also to those so far from the camera that no part of them is
    near; sentences about them by the numbers of their entries.

    Raises UsageError, AssetError where there is no such shape, or the asset has no stage `surface` or no such layer.
    """
    placed = {}
    for number, (entry, asset) in enumerate(zip(scene.values.materials, assets, strict=True)):
        if is_surface(entry.kind, entry.method):
            placed[number] = _put(scene, world, asset, number)
        elif declared(entry.kind)[chosen(entry.kind, entry.method)].surface_far:
            begins = _onset(scene, world, asset, number)
            nearest = onset.reach(world, entry.where.shape)[0]
            if nearest > 0 and 2 * begins.near <= nearest:  # else the camera may stand in it
                placed[number] = onset.in_words(number, begins), *_put(scene, world, asset, number)
    return placed


def changing(scene, world, assets, placed) -> dict[int, Changing]:
    """Entries that are surfaces far from the camera, and not `placed`, by their numbers."""
    return {number: _changing(scene, world, asset, number)
            for number, (entry, asset) in enumerate(zip(scene.values.materials, assets, strict=True))
            if number not in placed and declared(entry.kind)[chosen(entry.kind, entry.method)].surface_far}


def _changing(scene, world, asset, number) -> Changing:
    entry, key = scene.values.materials[number], f"materials[{number}]"
    begins = _onset(scene, world, asset, number)
    if begins.near >= onset.reach(world, entry.where.shape)[1]:
        return Changing(None, (onset.in_words(number, begins),))
    bsdf = mi.load_dict({"type": "bakedbsdf", "filename": str(asset.path), "layer": entry.layer or 0})
    layer = layers.load(str(asset.path), entry.layer or 0)
    stated = declared(entry.kind)[entry.method].leaves_out
    return Changing(Far(bsdf, begins.near), (
        onset.in_words(number, begins), f"{key}: {stated}",
        f"{key}: the reflectance of its surface is looked up within {100 * layer.error:.2g} %, at angles to 89.9 degrees",
        *_facets_in_words(key, layer)))


def _onset(scene, world, asset, number):
    """`onset.Onset` of an entry; UsageError where its surface is not that of what fills the shape."""
    entry = scene.values.materials[number]
    _refuse_without(scene, asset, number)
    if fault := onset.unfit(entry, asset, world):
        raise scene.wrong(f"materials[{number}].method", f"found {entry.method}, but {fault}; use paths, or another asset")
    return onset.of(scene, number, asset, world)


def _put(scene, world, asset, number) -> tuple[str, ...]:
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
    return (*reasons, *_facets_in_words(key, layer))


def _facets_in_words(key, layer) -> tuple[str, ...]:
    """What paths through the same boundary lose; nothing of a smooth one."""
    return (f"{key}: light that meets several facets of its rough boundary goes on; paths through Mitsuba's roughdielectric "
            "lose it, and are darker (docs/translucent.md)",) if layer.rough else ()


def _refuse_without(scene, asset, number) -> None:
    if "surface" not in asset.stages:
        raise scene.wrong(f"materials[{number}].method", f"found surface, and {asset.path} has no stage surface; use a section "
                          "surface: {thickness: infinite} in its recipe, or another method")
    layer, count = scene.values.materials[number].layer or 0, asset.surface.layers
    if layer >= count:
        raise scene.wrong(f"materials[{number}].layer", f"found no layer {layer}; {asset.path} has {count}: 0 to {count - 1}")


def _spread_in_words(scene, world, asset, layer, shape, size) -> str:
    far = float(np.max(spreading.spread(asset, layer)))
    source = "by walks" if spreading.baked(asset) else "by diffusion"
    words = f"light leaves it up to {length(far)} (root mean square, {source}) from where it came in"
    if world.camera is None:
        return words
    box = world.unit * np.array([shape.bbox().min, shape.bbox().max], float).reshape(2, 3)
    nearest = float(np.linalg.norm(np.clip(world.camera.origin, box[0], box[1]) - world.camera.origin))
    pixel = nearest * world.camera.pixel
    compared = (f"a pixel is {length(pixel)} wide at the nearest of its box, and that {length(size)}: regions of a "
                f"ball as wide would be off by {100 * spreading.OFF * far / (0.5 * size):.2g} % or less")
    verdict = "; use another method where it is near" if far > pixel else ""
    return f"{words}; {compared}{verdict}"
