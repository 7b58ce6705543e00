"""The standard preview of an asset: a block of its medium on a checkered ground, and a strip with its phase function.

The block floats in a dark studio under a large soft key light from the left and a strong rim light from behind, which
shows forward scattering.  Its edge is chosen so that the medium is seen, neither a veil nor a brick; the report and the
strip say how long it is.  Its surface is index-matched: light enters and leaves without reflection or refraction.
"""

from __future__ import annotations

import os
import time

import numpy as np

from bakery.errors import AssetError, UsageError
from renderers import colour, images
from renderers.mitsuba import lobe, passes, tables as asset_tables, variants

# width in pixels, samples a pixel and wavelength, noise to stop at, seconds after which no pass is begun
QUALITY = {"draft": (320, 8, 0.10, 30.0), "preview": (576, 24, 0.05, 120.0), "final": (1280, 64, 0.02, 600.0)}
# A scalar variant calls the plugin once an event, about 100 times slower.
SCALAR_QUALITY = {"draft": (128, 2, 0.10, 30.0), "preview": (192, 4, 0.05, 90.0), "final": (320, 8, 0.02, 600.0)}
REDUCED_PATHS, DIFFUSION_LENGTHS, MEAN_FREE_PATHS = 5.0, 2.5, 60.0
EXPOSURE = 1.6
CHECKED = 16.0  # width of the checked part of the ground, in block edges


def block_edge(asset) -> tuple[float, str]:
    """Edge of the block in m, and in words what set it.

    The shortest of 5 reduced mean free paths (beyond that a block is a brick), 2.5 diffusion lengths (beyond that it is
    black) and 60 mean free paths (beyond that it takes minutes), at the wavelength next to 0.55 um.
    """
    medium = asset.medium
    sigma_t, albedo, g = (np.asarray(array, dtype=float) for array in (medium.sigma_t, medium.albedo, medium.g))
    k = int(np.argmin(np.abs(np.asarray(asset.wavelength) - 0.55)))
    k = k if sigma_t[k] > 0 else int(np.argmax(sigma_t))
    if not sigma_t[k] > 0:
        raise AssetError("medium/sigma_t is 0 at every wavelength: there is nothing to see; "
                         "give the recipe a number_density or volume_fraction")
    reduced = sigma_t[k] * (1 - albedo[k] * g[k])
    diffusion = np.sqrt(3 * sigma_t[k] * (1 - albedo[k]) * reduced)
    lengths = {f"{REDUCED_PATHS:g} reduced mean free paths": REDUCED_PATHS / reduced,
               f"{DIFFUSION_LENGTHS:g} diffusion lengths": DIFFUSION_LENGTHS / max(diffusion, 1e-300),
               f"{MEAN_FREE_PATHS:g} mean free paths": MEAN_FREE_PATHS / sigma_t[k]}
    words = min(lengths, key=lengths.get)
    return float(lengths[words]), f"{words} at {asset.wavelength[k]:.3f} um"


def preview(asset_path, output_path, *, quality="preview", width=None, spp=None, tolerance=None, time_limit=None, variant=None,
            seed=0, denoise=True, progress=None) -> dict:
    """Renders the standard preview to a PNG and an EXR file beside each other.

    Parameters
    ----------
    asset_path : a baked asset with a `medium`
    output_path : `X.png` or `X.exr`; both are written
    quality : `draft`, `preview` or `final`: defaults of the next four
    width : pixels
    spp : samples a pixel and wavelength, at most
    tolerance : noise at which to stop: root mean square standard error of the luminance over its mean
    time_limit : seconds after which no further pass is begun
    variant : of Mitsuba; default the best that the machine can run
    denoise : whether the PNG shows the filtered picture; the EXR never does
    progress : function of (fraction 0 to 1, noise so far or None), called after each wavelength of each pass

    Returns
    -------
    report : dict with `files`, `variant`, `reason`, `seconds`, `samples`, `noise` (of the EXR), `noise_shown` (of the PNG),
        `stopped_by`, `block_edge` (m), `block`, `rows` (of the rendered picture; the strip is below), `tone_curve`, `exposure`

    Raises
    ------
    UsageError : unknown quality or variant, or a place that cannot be written, before any rendering
    AssetError : a damaged asset, or one without a medium
    """
    begin = time.monotonic()
    if quality not in QUALITY:
        raise UsageError(f"quality {quality!r}: one of {', '.join(QUALITY)} would do")
    png, exr = images.output_pair(output_path)
    asset = asset_tables.open_asset(asset_path)
    edge, words = block_edge(asset)
    chosen, reason = variants.activate("mono", variant)
    if "mono" not in chosen and not chosen.startswith("scalar"):
        raise UsageError(f"variant {chosen!r}: the preview renders one wavelength at a time; llvm_ad_mono, cuda_ad_mono or "
                         "scalar_rgb would do")
    scalar = chosen.startswith("scalar")
    defaults = (SCALAR_QUALITY if scalar else QUALITY)[quality]
    given = (width, spp, tolerance, time_limit)
    width, spp, tolerance, time_limit = (b if a is None else a for a, b in zip(given, defaults))
    if width < 16 or spp < 1:
        raise UsageError(f"width {width}, spp {spp}: at least 16 pixels and 1 sample are needed")
    height = width * 5 // 8
    scenes = [_scene(asset, os.path.abspath(asset_path), k, edge, width, height) for k in range(len(asset.wavelength))]
    picture = passes.render(scenes, colour.srgb_matrix(asset.wavelength), samples=spp, per_pass=max(1, min(4, spp // 2)),
                            tolerance=tolerance, time_limit=time_limit, seed=seed, progress=progress)
    shown, noise_shown = picture.rgb, picture.noise
    if denoise:
        first, second = images.filtered(picture.halves, 2 * picture.variance)
        shown = (first + second) / 2
        noise_shown = images.relative_noise(shown, ((first - second) / 2) ** 2)
    strip = lobe.strip(asset, asset_tables.load(asset_path), width,
                       (f"block edge {lobe.length(edge)} = {words}", f"checks {lobe.length(edge / 4)}   ·   {chosen}"))
    display = np.concatenate([images.tone_map(shown, EXPOSURE), strip])
    linear = np.concatenate([picture.rgb, colour.decode(strip)])
    _write(png, exr, display, linear)
    return {"files": [str(png), str(exr)], "variant": chosen, "reason": reason, "seconds": time.monotonic() - begin,
            "samples": picture.samples, "noise": picture.noise, "noise_shown": noise_shown, "stopped_by": picture.stopped_by,
            "block_edge": edge, "block": f"{lobe.length(edge)} ({words})", "width": width, "rows": height,
            "tone_curve": images.TONE_CURVE, "exposure": EXPOSURE}


def _write(png, exr, display, linear):
    import mitsuba as mi

    images.write([(png, lambda path: mi.Bitmap(np.round(255 * display).astype(np.uint8)).write(path)),
                  (exr, lambda path: mi.Bitmap(linear.astype(np.float32)).write(path))])


def _scene(asset, asset_path, k, edge, width, height):
    """The studio, in units of the block's edge, z up, with the medium at wavelength k."""
    import mitsuba as mi

    place = mi.ScalarTransform4f
    sigma_t, albedo, g = (float(array[k]) for array in (asset.medium.sigma_t, asset.medium.albedo, asset.medium.g))

    def softbox(origin, half_width, half_height, radiance):
        aim = place().look_at(origin=origin, target=[0, 0, 0.5], up=[0, 0, 1])
        return {"type": "rectangle", "bsdf": {"type": "diffuse", "reflectance": 0.0},
                "to_world": aim @ place().scale([half_width, half_height, 1]),
                "emitter": {"type": "area", "radiance": radiance}}

    centre = place().translate([0.5, 0.5, 0])
    # Roulette before 1 / (1 - albedo) events would end paths that still carry nearly all of their light.
    patience = int(np.clip(1 / max(1 - albedo, 1e-9), 8, 2000))
    return mi.load_dict({
        "type": "scene",
        "integrator": {"type": "volpath", "max_depth": 100_000, "rr_depth": patience},
        "sensor": {"type": "perspective", "fov": 30.0,
                   "to_world": place().look_at(origin=[-2.3, -3.9, 1.45], target=[0.05, 0, 0.47], up=[0, 0, 1]),
                   "film": {"type": "hdrfilm", "width": width, "height": height, "pixel_format": "luminance",
                            "rfilter": {"type": "box"}},
                   "sampler": {"type": "independent"}},
        "ground": {"type": "rectangle", "to_world": place().scale([500, 500, 1]),
                   "bsdf": {"type": "diffuse", "reflectance": {
                       "type": "bitmap", "bitmap": mi.Bitmap(_checks()), "raw": True, "filter_type": "nearest",
                       "wrap_mode": "clamp", "to_uv": centre @ place().scale(1000 / CHECKED) @ centre.inverse()}}},
        "block": {"type": "cube", "to_world": place().translate([0, 0, 0.502]) @ place().scale(0.5), "bsdf": {"type": "null"},
                  "interior": {"type": "homogeneous", "sigma_t": sigma_t * edge, "albedo": albedo,
                               # Aiming at the lights pays for round lobes; through a forward peak it doubles the time for little.
                               "sample_emitters": g < 0.8,
                               "phase": {"type": "bakedphase", "filename": asset_path, "channel": k}}},
        "key": softbox([-4.5, -1.0, 3.6], 2.0, 2.0, 2.4),
        "rim": softbox([2.7, 3.4, 2.2], 1.2, 0.9, 8.0),
        "fill": {"type": "constant", "radiance": 0.02},
    }, optimize=False)  # optimised, the order of the lights changes from run to run, and with it the noise


def _checks():
    """The ground's reflectance: checks of a quarter of the block's edge, fading into the dark of the studio."""
    x = (np.arange(int(16 * CHECKED)) + 0.5) / 16 - CHECKED / 2
    dark = (np.floor(4 * x)[:, None] + np.floor(4 * x)) % 2
    fade = 1 / (1 + (np.hypot(x[:, None], x) / 2.7) ** 5)
    return ((0.48 - 0.28 * dark) * fade + 0.015).astype(np.float32)[..., None]
