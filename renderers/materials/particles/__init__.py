"""Separate particles: fog whose droplets can be seen, glitter, dust in a beam of light."""

from __future__ import annotations


def render(scene, output=None, *, overrides=None, quality=None, variant=None, seed=None, progress=None, overwrite=False,
           resume=False) -> dict:
    """Renders a scene file to a PNG and an EXR file beside each other.

    Parameters
    ----------
    scene : path of the scene, or what `renderers.scene.load` made of it
    output : `X.png` or `X.exr`, both are written; beside the scene, by its name, if None
    overrides : dotted key -> value as text, such as `{"materials[0].method": "continuous"}`; of a path
    quality : draft, preview or final: noise, time and samples by the scene's `stop`
    variant : of Mitsuba, one for colours on arrays
    seed : of the passes; 0 if None
    progress : function of (fraction 0 to 1, noise or None)
    overwrite : replace also files that are no such pictures; never one that the scene reads
    resume : go on with the passes in the EXR file

    Returns
    -------
    report : that of `renderers.pictures.progressive`, with `particles` (number, or the expected one), `optical_depth` (of the
        region's longest edge, smallest and largest wavelength's), `as_particles` (share of the pixels that show any as particles)

    Raises
    ------
    RecipeError : with every problem of the scene
    UsageError, AssetError : a file is not what it should be; the text says which and why
    Interrupted : after what is there was written

    Notes
    -----
    EXR layers: order0 (not scattered by particles), order1, order2, orders (three times and more), light.NAME (from each light),
    noise (standard error), detail (m, depth up to which particles are particles), method (0: continuous, 1: particles, 2: both).
    """
    from renderers.materials.particles import methods
    from renderers.pictures import passes

    return passes.render(methods.prepare, scene, output, overrides=overrides, quality=quality, variant=variant, seed=seed,
                         progress=progress, overwrite=overwrite, resume=resume)


def describe(report) -> list[str]:
    """Lines for people."""
    from renderers.pictures import running

    return running.describe(report)
