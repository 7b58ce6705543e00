"""The standard preview of an asset: a block of its medium in a studio, and a strip with its phase function.

The edge of the block is chosen so that the medium is seen, neither a veil nor a brick; the report and the strip say how
long it is.  Its surface is index-matched: light enters and leaves without reflection or refraction.
"""

from __future__ import annotations

import os
import time

import numpy as np

from bakery.errors import AssetError, UsageError
from renderers import colour, images
from renderers.mitsuba import lobe, passes, studio, variants
from renderers.mitsuba import tables as asset_tables

# width in pixels, samples a pixel and wavelength, noise to stop at, seconds after which no pass is begun
QUALITY = {"draft": (320, 8, 0.10, 30.0), "preview": (576, 32, 0.05, 120.0), "final": (1280, 96, 0.03, 900.0)}
REDUCED_PATHS, DIFFUSION_LENGTHS, MEAN_FREE_PATHS = 3.0, 4.0, 60.0
AIM = 0.3  # mean cosine below which aiming at the lights was measured to pay (haze yes, soot even, milk no)
EXPOSURE, WHITE = 1.4, 1.6


def block_edge(asset) -> tuple[float, str]:
    """Edge of the block in m, and in words what set it.

    The shortest of 3 reduced mean free paths (beyond that a block is a brick), 4 diffusion lengths (beyond that it is black)
    and 60 mean free paths (beyond that it takes minutes), each at the wavelength where it is shortest: so the block shows
    its colour, whether it scatters or absorbs some wavelengths more than others.
    """
    medium = asset.medium
    sigma_t, albedo, g = (np.asarray(array, dtype=float) for array in (medium.sigma_t, medium.albedo, medium.g))
    if not np.any(sigma_t > 0):
        raise AssetError("medium/sigma_t is 0 at every wavelength: there is nothing to see; "
                         "give the recipe a number_density or volume_fraction")
    reduced = sigma_t * (1 - albedo * g)
    diffusion = np.sqrt(3 * sigma_t * (1 - albedo) * reduced)
    limits = {f"{REDUCED_PATHS:g} reduced mean free paths": (REDUCED_PATHS, reduced),
              f"{DIFFUSION_LENGTHS:g} diffusion lengths": (DIFFUSION_LENGTHS, diffusion),
              f"{MEAN_FREE_PATHS:g} mean free paths": (MEAN_FREE_PATHS, sigma_t)}
    lengths = {words: count / max(inverse.max(), 1e-300) for words, (count, inverse) in limits.items()}
    words = min(lengths, key=lengths.get)
    return float(lengths[words]), f"{words} at {asset.wavelength[int(np.argmax(limits[words][1]))]:.3f} um"


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
        `stopped_by`, `block_edge` (m), `block`, `rows` (of the rendered picture; the strip is below), `tone_curve`, `exposure`,
        `white`, `misdirected` (share of the scattered light that the table sends to another angle; 0 but in scalar variants)

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
    given = (width, spp, tolerance, time_limit)
    width, spp, tolerance, time_limit = (b if a is None else a for a, b in zip(given, QUALITY[quality]))
    if width < 16 or spp < 1:
        raise UsageError(f"width {width}, spp {spp}: at least 16 pixels and 1 sample are needed")
    height = width * 5 // 8
    import mitsuba as mi

    scenes, losses = zip(*(_scene(mi, asset, os.path.abspath(asset_path), k, edge, width, height)
                           for k in range(len(asset.wavelength))))
    picture = passes.render(scenes, colour.srgb_matrix(asset.wavelength), samples=spp, per_pass=max(1, min(4, spp // 2)),
                            tolerance=tolerance, time_limit=time_limit, seed=seed, progress=progress)
    shown, noise_shown = picture.rgb, picture.noise
    if denoise:
        first, second = images.filtered(picture.halves, 2 * picture.variance,
                                        studio.features(width, height, edge * np.asarray(asset.medium.sigma_t).max()))
        shown = (first + second) / 2
        noise_shown = images.relative_noise(shown, ((first - second) / 2) ** 2)
    strip = lobe.strip(asset, asset_tables.load(asset_path), width,
                       (f"block edge {lobe.length(edge)} = {words}",
                        f"checks {lobe.length(studio.CHECK * edge)}   ·   {chosen}"))
    display = np.concatenate([images.tone_map(shown, EXPOSURE, WHITE), strip])
    linear = np.concatenate([picture.rgb, colour.decode(strip)])
    _write(png, exr, display, linear)
    return {"files": [str(png), str(exr)], "variant": chosen, "reason": reason, "seconds": time.monotonic() - begin,
            "samples": picture.samples, "noise": picture.noise, "noise_shown": noise_shown, "stopped_by": picture.stopped_by,
            "block_edge": edge, "block": f"{lobe.length(edge)} ({words})", "width": width, "rows": height,
            "tone_curve": images.TONE_CURVE, "exposure": EXPOSURE, "white": WHITE,
            "misdirected": max((loss.misdirected for loss in losses if loss), default=0.0)}


def _write(png, exr, display, linear):
    import mitsuba as mi

    images.write([(png, lambda path: mi.Bitmap(np.round(255 * display).astype(np.uint8)).write(path)),
                  (exr, lambda path: mi.Bitmap(linear.astype(np.float32)).write(path))])


def _scene(mi, asset, asset_path, k, edge, width, height):
    """The studio with the medium at wavelength k, and what its phase function has lost (None: nothing)."""
    sigma_t, albedo, g = (float(array[k]) for array in (asset.medium.sigma_t, asset.medium.albedo, asset.medium.g))
    lost, phase = None, {"type": "bakedphase", "filename": asset_path, "channel": k}
    if mi.variant().startswith("scalar"):
        # Every event would be a call of Python; Mitsuba's own table is faster by far and loses next to nothing.
        values, lost = asset.medium.phase.regular(k)
        phase = {"type": "tabphase", "values": ",".join(map("{:.9g}".format, values.tolist()))}
    medium = {"type": "homogeneous", "sigma_t": sigma_t * edge, "albedo": albedo, "phase": phase,
              # Aiming at the lights pays for round lobes; in a forward peak it doubles the time for little.
              "sample_emitters": g < AIM}
    # Roulette before 1 / (1 - albedo) events would end paths that still carry nearly all of their light.
    return studio.scene(mi, medium, width, height, int(np.clip(1 / max(1 - albedo, 1e-9), 8, 2000))), lost
