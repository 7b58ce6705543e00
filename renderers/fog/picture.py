"""Pictures without fog: radiance, distance and the camera that saw them, from files or from a Mitsuba scene.

A pixel has one distance, that of the ray through its centre.  A mean over the pixel's samples would put the edge of a roof
halfway to the hill behind, where nothing is; the smallest distance would widen what is near.  Colours at edges stay means.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from bakery.errors import UsageError
from renderers.camera import Camera, length
from renderers.pictures import denoise, images, reached
from renderers.pictures.means import student

_ALPHA = 1 - 1e-6
_MOST = 1 << 20  # samples a pixel, where noise ends a picture
_FEATURES = 16  # samples a pixel of albedo and normal
_SHARED = 'the film spreads samples over pixels; <rfilter type="box"/> keeps them apart'


@dataclass(frozen=True, eq=False)
class Picture:
    """What a camera sees without fog.

    rgb : (H, W, 3) linear sRGB radiance
    distance : (H, W) m along the rays through the middles of the pixels; inf where there is no surface
    camera : Camera
    made : dict, how, for the report
    unsure : (H, W, 3), half the difference of two halves of the passes, whose square is in the mean the variance of `rgb`; None
        of files
    cleared : function that gives the same without its noise, a `renderers.pictures.denoise.Denoised`; None of files
    shared : sentence, why its pixels share their noise; "" where they do not
    """

    rgb: np.ndarray
    distance: np.ndarray
    camera: Camera
    made: dict = field(default_factory=dict)
    unsure: np.ndarray | None = None
    cleared: Callable[[], denoise.Denoised] | None = None
    shared: str = ""


# ---- from files


def from_files(color, depth, look, *, layer=None, channel=None, measure="distance", unit=1.0, sky=None):
    """A picture from a file of radiance and a file of distances.

    color : .exr (linear) or .png (sRGB); alpha is not looked at in EXR files and has to be 1 in PNG files
    depth : .exr, .npy (H, W) or .png of 16 bits
    look : origin, target, up (m) and fov (rad) of the camera, such as the section `camera` of a scene
    layer, channel : of EXR files with several
    measure : `distance` from the camera, or `z`, along its axis
    unit : m, of the depth's numbers
    sky : the depth's number for no surface, besides inf

    Raises UsageError: a file that cannot be read, or holds no such layer; sizes that differ; something that is no distance.
    """
    rgb = read_color(color, layer)
    images.refuse_too_large(color, *rgb.shape[:2])
    raw = read_depth(depth, channel)
    if rgb.shape[:2] != raw.shape:
        raise UsageError(f"{depth}: found {_size(raw)} pixels; {color} has {_size(rgb)}")
    distance = raw * float(unit)
    if sky is not None:
        distance[np.isclose(raw, sky, rtol=1e-6, atol=0)] = np.inf
    _refuse(~(distance > 0), f"{depth}: found the depth {{:g}} at {{}}; numbers above 0 would do "
            "(`sky:` names the number that means no surface)", raw)
    camera = Camera.looking(look.origin, look.target, look.up, look.fov, *raw.shape)
    if measure == "z":
        distance = distance * length(camera.points(*raw.shape))
    return Picture(rgb, distance, camera, {"from": "files", "color": str(color), "depth": str(depth)})


def read_color(path, layer=None):
    """Linear radiance (H, W, 3) of an EXR or PNG file."""
    from renderers.mitsuba import bitmaps

    path = Path(path)
    if path.suffix.lower() not in (".exr", ".png"):
        raise UsageError(f"{path}: found a file that ends in {path.suffix or 'nothing'}; .exr or .png would do")
    bitmap = bitmaps.opened(path)
    if path.suffix.lower() == ".png":
        if layer is not None:
            raise UsageError(f"{path}: found a PNG file, which has no layer {layer}; an EXR file would do")
        mi = bitmaps.library()
        alpha = bitmaps.channels_of(bitmap.convert(component_format=mi.Struct.Type.Float32)).get("A", 1.0)
        if np.any(alpha < _ALPHA):
            raise UsageError(f"{path}: found transparent pixels; a picture without alpha would do")
        linear = bitmap.convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32, srgb_gamma=False)
        return np.array(linear, float)
    rgb = _layer(path, bitmaps.channels_of(bitmap), layer).astype(float)
    _refuse(~np.isfinite(rgb).all(axis=2), f"{path}: found the radiance {{:g}} at {{}}; finite numbers would do", rgb.sum(axis=2))
    return rgb


def _layer(path, channels, layer):
    """Red, green and blue of a layer; of the only one, or the nameless one, where none is named."""
    prefix = "" if layer is None else f"{layer}."
    layers = [layer or ""] if all(prefix + c in channels for c in "RGB") else []
    if layer is None and not layers:
        layers = [name.removesuffix(".R") for name in channels if name.endswith(".R")
                  and all(f"{name[:-1]}{c}" in channels for c in "GB")]
    if len(layers) == 1:
        prefix = f"{layers[0]}." if layers[0] else ""
        return np.stack([channels[prefix + c] for c in "RGB"], axis=2)
    grey = f"{prefix}Y"
    if not layers and grey in channels:
        return np.repeat(channels[grey][..., None], 3, axis=2)
    expected = "the name of one as `layer:`" if layers else f"{prefix}R, {prefix}G and {prefix}B, or {grey},"
    raise UsageError(f"{path}: found the channels {_listed(channels)}; {expected} would do")


def read_depth(path, channel=None):
    """The numbers of a depth file (H, W), as they stand."""
    from renderers.mitsuba import bitmaps

    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in (".exr", ".npy", ".png"):
        raise UsageError(f"{path}: found a file that ends in {path.suffix or 'nothing'}; .exr, .npy or .png would do")
    if channel is not None and suffix != ".exr":
        raise UsageError(f"{path}: found a {suffix[1:].upper()} file, which has no channel {channel}; an EXR file would do")
    if suffix == ".npy":
        try:
            raw = np.load(path, allow_pickle=False, mmap_mode="r")
        except (OSError, ValueError, EOFError) as error:
            raise UsageError(f"{path}: cannot be read ({error})") from None
        if getattr(raw, "ndim", 0) != 2 or raw.dtype.kind not in "fiu" or not raw.size:
            raise UsageError(f"{path}: found {getattr(raw, 'dtype', type(raw))} of shape {getattr(raw, 'shape', '')}; "
                             "numbers of shape (height, width) would do")
        return np.array(raw, float)
    channels, _ = bitmaps.read(path)
    kind = next(iter(channels.values())).dtype
    if suffix == ".png" and (len(channels) > 1 or kind != np.uint16):
        raise UsageError(f"{path}: found a PNG of {len(channels)} channels, {kind}; one of 16 bits would do")
    if channel is None and len(channels) > 1:
        raise UsageError(f"{path}: found the channels {_listed(channels)}; the name of one as `channel:` would do")
    if channel is not None and channel not in channels:
        raise UsageError(f"{path}: found the channels {_listed(channels)}, and no {channel}")
    return (channels[channel] if channel is not None else next(iter(channels.values()))).astype(float)


def _listed(channels):
    return ", ".join(list(channels)[:20])


def _size(image):
    return f"{image.shape[1]} x {image.shape[0]}"


def _refuse(wrong, message, values):
    if wrong.any():
        y, x = np.argwhere(wrong)[0]
        further = f" and in {wrong.sum() - 1:,} more pixels" if wrong.sum() > 1 else ""
        raise UsageError(message.format(values[y, x], f"row {y}, column {x}{further}"))


# ---- from a Mitsuba scene


class Until(NamedTuple):
    """What ends a picture of a Mitsuba scene.

    samples : a pixel, at most; the quality takes a share of them.  If None as many as the noise takes, or where that is None what
        the scene asks for
    noise : relative, at which to stop; several times as much by quality.  In the fog, where `view_of` is given
    time : s, after which no pass is begun
    """

    samples: int | None = None
    noise: float | None = None
    time: float | None = None


def from_mitsuba(path, until=None, *, unit=1.0, quality="final", variant=None, seed=0, view_of=None, progress=None):
    """A picture of a Mitsuba scene, by the scene's own integrator, and the distances along rays through its sensor.

    path : Mitsuba XML, without fog; its first sensor is a perspective camera
    until : `Until`; None: as many samples as the scene asks for
    unit : m, of the scene's lengths
    view_of : function of (camera, distance) that gives a `renderers.fog.view.View`
    quality, variant, seed, progress : as in `renderers.mitsuba.render_scene`

    Distances are those of the first surface, whatever it is made of: glass, and the boundary of a medium, count as surfaces.
    """
    from renderers.mitsuba import passes, sensor
    from renderers.mitsuba.scene import load

    coarser, until = reached.coarser(quality), until or Until()
    scene, chosen, reason = load(path, variant=variant, integrator=True)
    first = scene.sensors()[0]
    width, height = (int(n) for n in first.film().crop_size())
    images.refuse_too_large(path, height, width)
    camera = sensor.camera_of(first, path, width, height)
    distance = unit * sensor.distances(scene, first, camera, height, width)
    camera = Camera(camera.origin * unit, camera.corner, camera.right, camera.down)
    asked = first.sampler().sample_count()
    noise = until.noise
    at_most = until.samples or (asked if noise is None else _MOST)
    samples = max(1, round(at_most / coarser**2))
    measure = None
    if noise and view_of:  # in fog
        view = view_of(camera, distance)
        measure = lambda picture: view.noise(picture.rgb, _error(picture))  # noqa: E731
    picture = passes.render([scene], None, samples=samples, per_pass=max(1, -(-min(samples, asked) // 8)), seed=seed,
                            tolerance=0.0 if noise is None else noise * coarser, time_limit=until.time, measure=measure,
                            progress=progress)
    origin = {"from": "mitsuba", "scene": str(path), "variant": chosen, "reason": reason, "samples": picture.samples,
            "noise": picture.noise, "stopped_by": picture.stopped_by, "at_most": at_most}

    def cleared():
        return denoise.denoised({"picture": (picture.rgb, picture.variance)}, features=_features(scene, distance),
                                widened={"picture": student([1.0], [picture.count])})

    shared = "" if first.film().rfilter().is_box_filter() else _SHARED
    return Picture(picture.rgb, distance, camera, origin, _error(picture), cleared, shared)


def _features(scene, distance):
    """Albedo and normal of the surfaces that the camera meets first, for the filter."""
    import mitsuba as mi

    from renderers.mitsuba.recording import undisturbed

    integrator = mi.load_dict({"type": "aov", "aovs": "albedo:albedo,normal:sh_normal"})
    with undisturbed():
        layers = np.array(mi.render(scene, integrator=integrator, spp=_FEATURES), dtype=float)
    return denoise.Features(np.clip(layers[..., -6:-3], 0, 1), layers[..., -3:], distance)


def _error(picture):
    """(H, W, 3), of a picture by chance."""
    return 0.5 * (picture.halves[0] - picture.halves[1])
