"""Fog in screen space: a picture without fog and its distances become the picture with fog."""

import numpy as np

from bakery.errors import UsageError
from renderers import colour
from renderers.pictures import denoise


def render(scene, output=None, *, overrides=None, quality=None, variant=None, seed=None, progress=None, overwrite=False) -> dict:
    """Renders a scene file to a PNG and an EXR file beside each other.

    Parameters
    ----------
    scene : path of the scene, or what `renderers.scene.load` made of it
    output : `X.png` or `X.exr`, both are written; beside the scene, by its name, if None
    overrides : dotted key -> value as text, such as `{"fog.density.scale": "5"}`; of a path
    quality : how close the filter's points are (`filter.POINTS`); also of the Mitsuba scene, if the picture comes from one
    variant, seed : of that scene, as in `renderers.mitsuba.render_scene`; with a variant `cuda_…` the filter runs on the card
    progress : function of (fraction 0 to 1, noise or None)
    overwrite : replace also files that are no such pictures; never one that the scene reads

    Returns
    -------
    report : that of `renderers.pictures.running`, with `picture` (how it was made), `optical_depth` (smallest, median and
        largest, a channel), `share_scattered` (of the picture's luminance), `share_sun` (of it), `filter` (its points; their
        measured error)

    Raises
    ------
    RecipeError : with every problem of the scene
    UsageError, AssetError : a file is not what it should be; the text says which and why

    Notes
    -----
    Noise of a picture from Mitsuba is that of two halves of its passes, each of which is filtered; of files it is not known.
    The EXR holds R, G, B, that noise as `noise.R` … (standard error, a mean over some pixels), the picture without fog as
    `clear.R`, `clear.G`, `clear.B`, both without their noise where that is taken out (`denoised.R` …, `denoised.clear.R` …), and
    `distance` (m): with
    `picture: {color: X.exr, layer: clear, depth: X.exr, channel: distance, measure: distance}` it gets other fog in seconds.
    """
    from renderers.fog import kernels
    from renderers.fog.view import View
    from renderers.pictures.running import Render

    job = Render(scene, output, overrides=overrides, quality=quality, overwrite=overwrite, progress=progress)
    scene, asset = job.scene, job.asset
    try:
        medium = kernels.fog_of(asset, channels=3, kernel=scene.values.filter.kernel)
    except UsageError as error:
        raise scene.wrong("asset", error) from None
    density = _density(scene)
    job.part_over("prepare")

    def view_of(camera, distance):
        return View(scene, medium, density, camera, distance, quality or "final", (variant or "").startswith("cuda"))

    picture = _picture(scene, quality, variant, seed, job.progress(0.0, 0.5), view_of)
    job.part_over("picture")
    view = view_of(picture.camera, picture.distance)
    job.part_over("density")
    result = view.seen(picture.rgb, job.progress(0.5, 0.9))
    unsure = None if picture.unsure is None else view.unsure(picture.unsure)
    job.part_over("filter")
    if progress:
        progress(0.9)
    sunlight = _sunlight(scene, asset, medium, density, view.origin, view.rays, view.distance)
    job.part_over("sun")
    return _finished(job, picture, view, unsure, sunlight, result + sunlight)


def _denoised(job, picture, view, sunlight):
    """The foggy picture of the one without noise, `Denoised`, and what is to be said of it; None where the noise stays."""
    from renderers.pictures.running import rgb_layers

    filters, sentences = denoise.chosen(job.scene.values, job.quality, picture.shared) if picture.cleared else (False, [])
    if not filters:
        return None, sentences
    clear = picture.cleared()
    rgb = view.seen(clear.rgb) + sunlight
    channels = clear.channels | rgb_layers(denoise.PREFIX, rgb) | rgb_layers(f"{denoise.PREFIX}clear.", clear.rgb)
    job.part_over("denoising")
    return clear._replace(rgb=rgb, channels=channels), [*sentences, denoise.sentence(clear.figures)]


def _finished(job, picture, view, unsure, sunlight, rgb):
    """Writes the picture rgb (H, W, 3), with its error `unsure` (H, W, 3) or None, and gives the report."""
    from renderers.fog import noise
    from renderers.pictures import images, reached
    from renderers.pictures.running import rgb_layers
    from renderers.scene import budget

    clean, remarks = _denoised(job, picture, view, sunlight)
    total = float(np.mean(rgb @ colour.LUMINANCE))
    layers, relative = rgb_layers("clear.", picture.rgb) | {"distance": picture.distance}, None
    if unsure is not None:
        layers, relative = layers | noise.layers(unsure), images.relative_noise(rgb, unsure)
    wanted = reached.coarser(job.quality) * budget.of(job.scene).noise if reached.asked(job.scene.values) else None
    return job.finish(rgb, layers=layers, method="screen", reasons=[*_reasons(view, total), *remarks], denoised=clean,
                      samples=picture.made.get("samples"), picture=picture.made, noise=relative,
                      unreached=reached.unreached(picture.made.get("stopped_by", ""), wanted, relative),
                      **_figures(view, picture, sunlight, total))


def _reasons(view, total):
    """Sentences; total : mean luminance of the picture."""
    beside = "ambient light" if view.ambient.any() else {"edge": "what it shows nearby", "black": "darkness"}[view.outside]
    return [f"fog is a filter in screen space, for which {beside} lies beside the picture",
            *["no light is in the picture, and it stays black"] * (total == 0)]


def _figures(view, picture, sunlight, total):
    """What the report says of distances, depths and shares of the light."""
    from renderers.fog.filter import ERRORS

    direct = float(np.mean((view.through * picture.rgb) @ colour.LUMINANCE))
    scattered, sun = (1 - direct / total, float(np.mean(sunlight @ colour.LUMINANCE)) / total) if total > 0 else (0.0, 0.0)
    depths = {name: [float(f(view.depth[..., c])) for c in range(3)]
              for name, f in (("smallest", np.min), ("median", np.median), ("largest", np.max))}
    return {"without_surface": int(view.sky.sum()), "distance": [float(view.distance.min()), float(view.distance.max())],
            "optical_depth": depths, "share_scattered": scattered, "share_sun": sun,
            "filter": {"points": view.points, "error": ERRORS[view.points]}}


def describe(report) -> list[str]:
    """Lines for people."""
    from renderers.pictures import running
    from renderers.scene.budget import percent

    picture, depth = report["picture"], report["optical_depth"]
    source = f"{picture['color']} and {picture['depth']}" if picture["from"] == "files" else \
        f"{picture['scene']}, {picture['samples']} samples a pixel, noise {percent(picture['noise'])}, " \
        f"{picture['variant']} ({picture['reason']})"
    sky = f"; {report['without_surface']:,} pixels without a surface" if report["without_surface"] else ""
    red, green, blue = (" / ".join(f"{depth[name][c]:.3g}" for name in depth) for c in range(3))
    seen = [] if report["noise"] is None else [f"noise {percent(report['noise'])}"]
    return running.describe(report, [
        f"without fog: {source}; {report['size'][0]} x {report['size'][1]}{sky}", *seen,
        f"filter: {report['filter']['points']}, within {percent(report['filter']['error'])} of a sum over all pixels",
        f"optical depth (smallest / median / largest): red {red}; green {green}; blue {blue}",
        f"scattered: {100 * report['share_scattered']:.3g} % of the light"
        + (f", {100 * report['share_sun']:.3g} % from the sun" if report["share_sun"] else ""), *report.get("reasons", [])[1:]])


def _density(scene):
    from renderers.fog import density
    from renderers.scene import grids

    section = scene.values.fog.density
    if section.type == "uniform":
        return density.Uniform(section.scale)
    if section.type == "height":
        return density.Height(section.scale, section.base, section.falloff, tuple(section.up))
    values, lo, hi = grids.placed(scene, "fog.density", section, "file")
    return density.Grid(values, tuple(lo), tuple(hi), section.scale)


def _picture(scene, quality, variant, seed, progress, view_of=None):
    from renderers.fog import picture
    from renderers.pictures import reached
    from renderers.scene import budget

    section = scene.values.picture
    if hasattr(section, "mitsuba"):
        stop = scene.values.stop
        noise = budget.of(scene).noise if reached.asked(scene.values) else None
        until = picture.Until(section.samples, noise, reached.limit(stop.time, quality))
        return picture.from_mitsuba(scene.file(section.mitsuba), until, unit=section.unit, variant=variant,
                                    quality=quality or "final", seed=seed or 0, view_of=view_of, progress=progress)
    if not ((variant is None or variant.startswith("cuda")) and seed is None):
        raise UsageError(f"{scene.path}: found a variant or seed, which are those of Mitsuba scenes; none would do, as this "
                         "picture comes from files, or a variant cuda_… for a filter on the graphics card")
    return picture.from_files(scene.file(section.color), scene.file(section.depth), scene.values.camera, layer=section.layer,
                              channel=section.channel, measure=section.measure, unit=section.unit, sky=section.sky)


def _sunlight(scene, asset, medium, density, origin, rays, distance):
    """What the fog scatters of parallel light from outside the picture, (H, W, 3)."""
    from renderers.fog import external
    from renderers.fog.view import spread

    suns = [external.Sun(tuple(light.direction), tuple(spread(light.irradiance)))
            for light in scene.values.fog.light if light.type == "sun"]
    if not suns:
        return np.zeros(rays.shape)

    def phase(theta):
        values = asset.medium.phase(theta)
        return values[np.argsort(-np.asarray(asset.wavelength))] if len(values) == 3 else np.repeat(values, 3, axis=0)

    try:
        fog = external.Medium(spread(medium.sigma_t), spread(medium.sigma_s), phase)
        values = external.scattered(density, origin, rays.reshape(-1, 3), distance.ravel(), fog, suns,
                                    diffuse=scene.values.fog.diffuse)
    except UsageError as error:
        raise scene.wrong("fog.light", error) from None
    return values.reshape(rays.shape)
