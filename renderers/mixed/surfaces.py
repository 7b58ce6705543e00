"""Entries that are surfaces: shapes of the Mitsuba scene that get the plugin `bakedbsdf`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from renderers.scene.entries import declared, is_surface

# Root mean square error of regions over the spread of light over the radius of a ball, over the mean: 0.55, 0.27 to 0.45 and 0.22
# at albedo 0.9, 0.99 and 0.999 (docs/surface.md)
_OFF = 0.55
_MOST_PATHS = 1e4  # mean free paths, beyond which light that nothing absorbs counts as lost


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


def spread(asset, layer: int = 0) -> np.ndarray:
    """How far from where it came in light leaves an asset's layer, (L,) m: root mean square, as baked, or else by diffusion.

    Notes
    -----
    Counted among grains, and of former versions, assets hold none.  Of a point of light under the surface, a transport mean free
    path l' deep, and its image above it, at 2 l' of the boundary's own (index 1):
    <r^2> = 2 (z0 e^(-k z0) + z1 e^(-k z1)) / k / (e^(-k z0) + e^(-k z1)), z0 = l', z1 = 7/3 l'.  k is that of diffusion, and no
    less than pi over the thickness; without absorption and thickness it would have no end.
    Source: moments of Farrell, Patterson & Wilson, Med. Phys. 19, 879 (1992).
    """
    if _baked(asset):
        return 1e-6 * np.sqrt(np.asarray(asset.surface["mean_square"], float)[:, layer])
    medium = asset.medium
    sigma_t, albedo, g = (np.asarray(medium[name], float) for name in ("sigma_t", "albedo", "g"))
    reduced = np.maximum(sigma_t * (1 - albedo * g), 1e-30)
    absorbed = np.maximum(sigma_t * (1 - albedo), reduced / _MOST_PATHS**2)
    k = np.sqrt(3 * absorbed * reduced)
    thickness = asset.surface.get("thickness")
    if thickness is not None:
        k = np.maximum(k, np.pi / np.maximum(1e-6 * thickness[layer], 1e-30))
    near, far = 1 / reduced, 7 / 3 / reduced
    share, share_far = np.exp(-k * near), np.exp(-k * far)
    total = np.maximum(share + share_far, 1e-300)
    return np.where(share > 0, np.sqrt(2 * (near * share + far * share_far) / total / k), near)


def _baked(asset) -> bool:
    return "mean_square" in asset.surface


def _spread_in_words(scene, world, asset, layer, shape, size) -> str:
    far = float(np.max(spread(asset, layer)))
    source = "by walks" if _baked(asset) else "by diffusion"
    words = f"light leaves it up to {_length(far)} (root mean square, {source}) from where it came in"
    if world.camera is None:
        return words
    box = world.unit * np.array([shape.bbox().min, shape.bbox().max], float).reshape(2, 3)
    nearest = float(np.linalg.norm(np.clip(world.camera.origin, box[0], box[1]) - world.camera.origin))
    angle = float(np.sqrt(np.linalg.norm(world.camera.right) * np.linalg.norm(world.camera.down)))
    pixel = nearest * angle
    compared = (f"a pixel is {_length(pixel)} wide at the nearest of its box, and that {_length(size)}: regions of a ball as "
                f"wide would be off by {100 * _OFF * far / (0.5 * size):.2g} % or less")
    verdict = "; use another method where it is near" if far > pixel else ""
    return f"{words}; {compared}{verdict}"


def _length(metres: float) -> str:
    for unit, scale in (("um", 1e-6), ("mm", 1e-3)):
        if metres < 1e3 * scale:
            return f"{metres / scale:.2g} {unit}"
    return f"{metres:.3g} m"
