"""The standard preview of an asset: a block of its medium in a studio, and a strip with its phase function.

The edge of the block is chosen so that the medium is seen, neither a veil nor a brick; the report and the strip say how
long it is.  Its surface is index-matched: light enters and leaves without reflection or refraction.  Packed grains have a second
picture on the left: the exemplars themselves.
"""

import functools
import os
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bakery.errors import AssetError, UsageError
from bakery.grammar import qualities
from renderers import colour
from renderers.mitsuba import bitmaps, passes, variants
from renderers.mitsuba import tables as asset_tables
from renderers.mitsuba.scene import describe as describe_render
from renderers.pictures import images
from renderers.preview import grains, lobe, studio
from renderers.preview.lobe import length
from renderers.progress import share

REDUCED_PATHS, DIFFUSION_LENGTHS, MEAN_FREE_PATHS = 3.0, 4.0, 60.0
HEAP = 40.0  # mean free paths of a block of packed grains, about a hundred of their radii
HEAP_SAMPLES, HEAP_CLEAR = 0.5, 0.05  # share of the samples that it gets where less is absorbed in a collision: paths are long
AIM = 0.3  # mean cosine below which aiming at the lights was measured to pay (haze yes, soot even, milk no)
HEAP_PATIENCE = 6.0  # times 1 / (1 - albedo) events of a path before roulette
EXPOSURE, WHITE = 1.4, 1.6
PREVIEW_OF = "bakery content_hash"  # in the text of both files: by it `bake report` knows whose picture it is


def block_edge(asset, packed=False) -> tuple[float, str]:
    """Edge of the block in m, and in words what set it.

    The shortest of 3 reduced mean free paths (beyond that a block is a brick), 4 diffusion lengths (beyond that it is black)
    and 60 mean free paths (beyond that it takes minutes), each at the wavelength where it is shortest: so the block shows
    its colour, whether it scatters or absorbs some wavelengths more than others.  `packed`: a medium that stands for packed
    grains is a heap, not a veil, and means nothing at the size of a few grains: always 60 mean free paths.
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
    if packed:
        limits = {f"{HEAP:g} mean free paths": (HEAP, sigma_t)}
    lengths = {words: count / max(inverse.max(), 1e-300) for words, (count, inverse) in limits.items()}
    words = min(lengths, key=lengths.get)
    return float(lengths[words]), f"{words} at {asset.wavelength[int(np.argmax(limits[words][1]))]:.3f} um"


def preview(asset_path, output_path, *, quality="preview", panel=None, variant=None, seed=0, denoise=True, progress=None,
            overwrite=False) -> dict:
    """Renders the standard preview to a PNG and an EXR file beside each other.

    An asset of packed grains has two panels side by side: its exemplar grains, and a block of their equivalent medium.

    Parameters
    ----------
    asset_path : a baked asset with a `medium`, or with `grains`, or both
    output_path : `X.png` or `X.exr`; both are written
    quality : `draft`, `preview` or `final`
    panel : `bakery.grammar.qualities.Panel`, width, samples, noise (root mean square standard error of the luminance over its
        mean, of what the PNG shows) and seconds, of all panels together, instead of those of the quality
    variant : of Mitsuba; default the best that the machine can run
    denoise : whether the PNG shows the filtered picture, whose noise then stops the passes; the EXR never does
    progress : function of (fraction 0 to 1, noise so far or None), called after each wavelength of each pass
    overwrite : replace also files that are no such pictures

    Returns
    -------
    report : dict with `files`, `variant`, `reason`, `seconds`, `samples` (the fewest), `noise` (of the EXR, the largest),
        `noise_shown` (of the PNG), `stopped_by`, `noise_of` (whose noise was to be reached: `PNG` or `EXR`), `width` and `rows`
        (of the rendered picture; the strip is below), `tone_curve`, `exposure`, `white`, `panels` (a dict each: `shows`, `left`,
        `width` and its own samples and noise); with a medium `block_edge` (m), `block` and `misdirected` (share of the scattered
        light that the table sends to another angle; 0 but in scalar variants); with grains `grains` (names as shown),
        `grain_radius` (m) and `grains_left_out`

    Raises
    ------
    UsageError : unknown quality or variant, or a place that cannot be written, before any rendering
    AssetError : a damaged asset, or one without a medium and grains
    """
    begin = time.monotonic()
    width, spp, tolerance, time_limit = panel or qualities.quality(quality).panel
    if width < 16 or spp < 1:
        raise UsageError(f"width {width}, samples {spp}: at least 16 pixels and 1 sample are needed")
    images.refuse_name(asset_path)
    pair = images.output_pair(output_path, [asset_path], overwrite)
    asset, asset_path = asset_tables.open_asset(asset_path, ("grains", "medium")), os.path.abspath(asset_path)
    groups = [name for name in ("grains", "medium") if name in asset.stages]
    edge, words = block_edge(asset, "grains" in groups) if "medium" in groups else (0.0, "")
    shown = grains.grains_of(asset) if "grains" in groups else None
    chosen, reason = _variant(variant)
    panels, rendered = _panels(asset, asset_path, shown, edge, words, (width, width * 5 // 8), chosen), []
    for i, shown_panel in enumerate(panels):
        clean = _Filter(shown_panel.features) if denoise else None
        clear_heap = shown_panel.shows == "medium" and shown and np.max(asset.medium.albedo) > 1 - HEAP_CLEAR
        picture = passes.render(shown_panel.scenes(), colour.srgb_matrix(asset.wavelength),
                                samples=max(1, round(HEAP_SAMPLES * spp)) if clear_heap else spp,
                                per_pass=max(1, min(4, spp // 2)), tolerance=tolerance, time_limit=time_limit / len(panels),
                                seed=seed, measure=clean and clean.noise,
                                progress=share(progress, i / len(panels), (i + 1) / len(panels)))
        rendered.append((picture, *(clean(picture) if clean else (picture.rgb, picture.noise))))
    gap, strips = max(1, width // 96), [item.strip for item in panels]
    display = _beside([images.tone_map(pixels, EXPOSURE, WHITE) for _, pixels, _ in rendered], strips, gap)
    linear = _beside([picture.rgb for picture, _, _ in rendered], map(colour.decode, strips), gap)
    bitmaps.write(pair, display, linear, {PREVIEW_OF: asset.content_hash})
    report = {"files": [str(path) for path in pair], "variant": chosen, "reason": reason, "seconds": time.monotonic() - begin,
              "noise_of": "PNG" if denoise else "EXR", **_figures(panels, rendered, width, gap)}
    return report | {key: value for shown_panel in panels for key, value in shown_panel.report().items()}


def describe(report) -> list[str]:
    """Lines for the report of `preview`."""
    lines = describe_render(report)
    if len(report["panels"]) > 1:
        lines.append("panels: " + "; ".join(f"{panel['shows']}, {panel['samples']} samples, noise {100 * panel['noise']:.2g} %, "
                                            f"{100 * panel['noise_shown']:.2g} % filtered" for panel in report["panels"]))
    if "grains" in report:
        left_out = f", {report['grains_left_out']} left out" if report["grains_left_out"] else ""
        lines.append(f"grains: {', '.join(report['grains'])}{left_out}; bounding radius {length(report['grain_radius'])}")
    if "block" in report:
        lines.append(f"block: edge {report['block']}, surface index-matched")
    if report.get("misdirected"):
        lines.append(f"phase function: on a regular grid, which sends {100 * report['misdirected']:.2g} % of the light to "
                     "another angle; llvm and cuda variants use the asset's own table")
    return lines


@dataclass(frozen=True)
class Panel:
    """One rendered picture with its strip.

    shows : "grains" or "medium"
    scenes : () -> list of L scenes, made when they are rendered
    features : () -> (height, width, F) what the filter must keep
    strip : (H, width, 3) below the picture
    report : () -> what the report says of it, once it is rendered
    """

    shows: str
    scenes: Callable
    features: Callable
    strip: np.ndarray
    report: Callable


def _grains(mi, asset, shown, size) -> Panel:
    """The exemplars on the ground."""
    exemplars, radius, count = shown
    unit = grains.scale(len(exemplars))
    sizes = asset.grains["radius"]
    words = [f"R = {length(radius)}" + (f" on average, {length(sizes.min())} to {length(sizes.max())}"
                                             if len(sizes) > 1 else ""),
             f"checks {length(studio.CHECK * unit * radius)}"]
    words += [f"{len(exemplars)} of {count} components"] if count > len(exemplars) else []
    um = asset.wavelength[lobe.middle(asset)]
    strip = lobe.grain_strip(asset, exemplars, size[0], (
        "   ·   ".join(words), f"g, path (along the ray, through the bounding sphere) and phase function at {um:.3f} um",
        "delta: unscattered transmission, not in the curves"))

    def report():
        return {"grains": [grain.name for grain in exemplars], "grain_radius": radius, "grains_left_out": count - len(exemplars)}

    return Panel("grains", lambda: [grains.scene(mi, exemplars, radius, k, *size) for k in range(len(asset.wavelength))],
                 lambda: grains.features(mi, exemplars, radius, *size), strip, report)


def _block(mi, asset, asset_path, edge, words, size, chosen) -> Panel:
    """The block of the medium."""
    losses = []

    def scenes():
        built, lost = zip(*(_scene(mi, asset, asset_path, k, edge, *size) for k in range(len(asset.wavelength))))
        losses.extend(loss.misdirected for loss in lost if loss)
        return list(built)

    delta = lobe.forward_delta(asset)
    captions = [f"block edge {length(edge)} = {words}", f"checks {length(studio.CHECK * edge)}   ·   {chosen}"]
    captions += [f"not drawn: a peak with {100 * delta:.2g} % of the light"] if delta else []
    strip = lobe.strip(asset, asset_tables.load(asset_path), size[0], captions)
    return Panel("medium", scenes, lambda: studio.features(*size, edge * np.asarray(asset.medium.sigma_t).max()), strip,
                 lambda: {"block_edge": edge, "block": f"{length(edge)} ({words})", "misdirected": max(losses, default=0.0)})


def _variant(asked):
    """Mitsuba's variant for one wavelength at a time, which is set, and why it is that one."""
    chosen, reason = variants.activate("mono", asked)
    if "mono" not in chosen and not chosen.startswith("scalar"):
        raise UsageError(f"variant {chosen!r}: the preview renders one wavelength at a time; expected llvm_ad_mono, "
                         "cuda_ad_mono or scalar_rgb")
    return chosen, reason


def _panels(asset, asset_path, shown, edge, words, size, chosen) -> list[Panel]:
    """Those of the grains `shown`, None: there are none, and of a block of the medium, edge m; 0: there is none."""
    import mitsuba as mi

    panels = [_grains(mi, asset, shown, size)] if shown else []
    return panels + ([_block(mi, asset, asset_path, edge, words, size, chosen)] if edge else [])


class _Filter:
    """Takes noise out of a picture that is being rendered; what was filtered last is kept, for the PNG.

    features : of a `Panel`
    """

    def __init__(self, features):
        self._features, self._samples, self._kept = functools.cache(features), 0, None

    def __call__(self, picture):
        """Pixels (H, W, 3) without most of their noise, and the noise of these: of the filtered halves, half their difference."""
        if picture.samples != self._samples:
            first, second = images.filtered(picture.halves, 2 * picture.variance[..., :3], self._features())
            pixels = (first + second) / 2
            self._samples, self._kept = picture.samples, (pixels, images.relative_noise(pixels, (first - second) / 2))
        return self._kept

    def noise(self, picture) -> float:
        """That of `__call__`."""
        return self(picture)[1]


def _figures(panels, rendered, width, gap):
    """What the report says of panels `width` pixels wide, `gap` apart, with their pictures, what is shown of these, its noise."""
    figures = [{"shows": panel.shows, "left": i * (width + gap), "width": width, "samples": picture.samples,
                "noise": picture.noise, "noise_shown": noise, "stopped_by": picture.stopped_by}
               for i, (panel, (picture, _, noise)) in enumerate(zip(panels, rendered, strict=True))]
    worst = {"samples": min, "noise": max, "noise_shown": max,
             "stopped_by": lambda ends: min(ends, key=("time", "samples", "noise").index)}
    return {name: of([figure[name] for figure in figures]) for name, of in worst.items()} | {
        "width": width * len(rendered) + gap * (len(rendered) - 1), "rows": width * 5 // 8, "tone_curve": images.TONE_CURVE,
        "exposure": EXPOSURE, "white": WHITE, "panels": figures}


def _beside(pictures, strips, gap):
    """Pictures with their strips in a row, dark between them."""
    row = list(map(np.concatenate, zip(pictures, strips)))
    dark = np.full((row[0].shape[0], gap, 3), 0.005)
    return np.concatenate([part for item in row for part in (dark, item)][1:], axis=1)


def _scene(mi, asset, asset_path, k, edge, width, height):
    """The studio with the medium at wavelength k, and what its phase function has lost (None: nothing)."""
    sigma_t, albedo, g = (float(array[k]) for array in (asset.medium.sigma_t, asset.medium.albedo, asset.medium.g))
    heap = "grains" in asset.stages
    lost, phase = None, {"type": "bakedphase", "filename": asset_path, "channel": k}
    if mi.variant().startswith("scalar"):
        # Every event would be a call of Python; Mitsuba's own table is faster by far and loses next to nothing.
        deflecting = asset.medium.without_delta()
        sigma_t, albedo = float(deflecting.sigma_t[k]), float(deflecting.albedo[k])
        values, lost = deflecting.phase.regular(k)
        phase = {"type": "tabphase", "values": ",".join(map("{:.9g}".format, values.tolist()))}
    medium = {"type": "homogeneous", "sigma_t": sigma_t * edge, "albedo": albedo, "phase": phase,
              # Aiming at the lights pays for round lobes; in a forward peak, and deep in a heap, it doubles the time for little.
              "sample_emitters": g < AIM and not heap}
    # Roulette before 1 / (1 - albedo) events would end paths that still carry nearly all of their light.  At most 95 % of the
    # paths survive it, so weights grow from then on: bright dots in heaps, whose paths are long; there it starts later.
    patience = HEAP_PATIENCE if heap else 1.0
    return studio.scene(mi, medium, width, height, int(np.clip(patience / max(1 - albedo, 1e-9), 8, 2000 * patience))), lost
