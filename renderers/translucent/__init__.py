"""Translucent bodies: milk, wax, skin, soap, with the surfaces and lights around them."""

from __future__ import annotations


def render(scene, output=None, *, overrides=None, quality=None, variant=None, seed=None, progress=None, overwrite=False,
           resume=False) -> dict:
    """Renders a scene file to a PNG and an EXR file beside each other.

    Parameters
    ----------
    scene : path of the scene, or what `renderers.scene.load` made of it
    output : `X.png` or `X.exr`, both are written; beside the scene, by its name, if None
    overrides : dotted key -> value as text, such as `{"translucent.method": "paths"}`; of a path
    quality : draft, preview or final: noise, time and samples by the scene's `stop`
    variant : of Mitsuba, one for colours on arrays
    seed : of the passes; 0 if None
    progress : function of (fraction 0 to 1, noise or None)
    overwrite : replace also files that are no such pictures; never one that the scene reads
    resume : go on with the passes in the EXR file

    Returns
    -------
    report : that of `renderers.progressive`

    Raises
    ------
    RecipeError : with every problem of the scene
    UsageError, AssetError : a file is not what it should be; the text says which and why
    Interrupted : after what is there was written

    Notes
    -----
    EXR layers: order0 (light that no body scattered), order1, order2, orders (three events and more), noise (standard error);
    closer (what it would change if pixels shared light over half the distance).
    """
    from renderers import budget
    from renderers.mitsuba.world import World
    from renderers.progressive import Estimate, Stop, fingerprint, made_of
    from renderers.running import Render
    from renderers.translucent import methods

    job = Render(scene, output, overrides=overrides, overwrite=overwrite, progress=progress)
    scene, values, seed = job.scene, job.scene.values, seed or 0
    size = (values.film.height, values.film.width) if values.film.height else None
    surfaces = values.scene
    world = World(scene.file(surfaces.mitsuba), surfaces.unit, view=values.camera, size=size, variant=variant)
    if world.camera is None:
        raise scene.wrong("camera", "there is no camera; camera: {origin: …, target: …, fov: …} would do")
    job.part_over("scene")
    method = methods.prepare(job, world, seed)
    job.part_over("bodies")
    estimate = Estimate(method.parts, {"scene": fingerprint(*made_of(scene)), "seed": seed, "size": list(world.size),
                                       "asset": [asset.content_hash for asset in job.assets]})
    if resume:
        estimate.resume(job.pair[1])
    stop = Stop.of(budget.of(scene), values.measure, time=values.stop.time, samples=values.stop.samples, quality=quality)
    estimate.run(stop, job.progress(0.05, 0.98))
    job.part_over("passes")
    bias = methods.bias(estimate.means.values(), estimate.rgb)
    return estimate.finish(job, method=method.name, reasons=method.reasons, bias=bias)


def describe(report) -> list[str]:
    """Lines for people."""
    from renderers import running

    return running.describe(report)
