"""Scenes whose pictures are sums of passes, from their files to their reports: what is alike for separate particles, grains and
translucent bodies.

Each of these renderers has a `prepare`, which makes a `Method` of a scene.
"""

from __future__ import annotations

import gc
import math
from collections.abc import Callable
from typing import NamedTuple

from renderers import choice
from renderers.mitsuba.lights import DARK
from renderers.mitsuba.world import World
from renderers.pictures import denoise, images, reached
from renderers.pictures.means import student, tiled
from renderers.pictures.progressive import Estimate, Part, Stop, fingerprint, made_of
from renderers.pictures.running import Render
from renderers.scene import budget
from renderers.scene.budget import percent

DEPTH = "depth.Z"  # channel of the EXR: along the camera's axis, m, as other programs composite by


class Method(NamedTuple):
    """How a scene is rendered.

    Attributes
    ----------
    name : of the method
    parts : of the picture
    reasons : sentences
    after : function of the `Estimate` after the last pass, what `Estimate.finish` gets: layers, bias, figures of the renderer;
        further reasons
    approximations : error of the method as it was measured in this scene; None: what the renderer states
    features : what gives the `renderers.pictures.denoise.Features` of the scene; None: nothing does
    apart : names of parts whose detail looks like noise: they are not filtered
    entry : what `World.depth` takes: to what hides surfaces and is none of the Mitsuba scene; None: nothing does
    """

    name: str
    parts: tuple[Part, ...]
    reasons: list[str]
    after: Callable[[Estimate], dict]
    approximations: float | None = None
    features: Callable[[], denoise.Features | None] | None = None
    apart: tuple[str, ...] = ()
    entry: Callable | None = None


def render(prepare, path, output, *, overrides=None, quality=None, variant=None, seed=None, progress=None, overwrite=False,
           resume=False) -> dict:
    """Renders a scene; parameters, report and errors beyond these are those of `render` of its renderer.

    prepare : function of (`renderers.pictures.running.Render`, World, seed) -> Method
    """
    job = Render(path, output, overrides=overrides, quality=quality, overwrite=overwrite, progress=progress)
    scene, wanted, seed = job.scene, job.scene.values.stop, seed or 0
    world = World.of(scene, variant)
    if world.camera is None:
        raise scene.no_camera()
    images.refuse_too_large(scene.path, *world.size)
    job.part_over("scene")
    taken = choice.chosen(prepare, choice.Opened(scene, job.assets, job.asset), world, quality, job.pair[1] if resume else None)
    if taken is not None:
        job.part_over("choice")
        job.scene = choice.with_method(scene, taken.method)
    method = prepare(job, world, seed)
    job.part_over("preparation")
    estimate = Estimate(method.parts, {"scene": fingerprint(*made_of(scene)), "seed": seed, "size": list(world.size),
                                       "asset": [asset.content_hash for asset in job.assets]})
    if resume:
        estimate.resume(job.pair[1])
    measured = method.approximations if taken is None or taken.approximations is None else taken.approximations
    split = budget.of(job.scene, approximations=measured)
    stop = Stop.of(split, scene.values.measure, time=wanted.time, samples=wanted.samples, quality=quality)
    reasons = [*(taken.reasons if taken else []), *method.reasons, *split.lacking]
    if world.dark:
        # no pass will find anything by chance; the picture has its layers all the same
        stop, reasons = Stop(samples=1), [DARK]
    # Dr.Jit compiles a call for the surfaces and lights of all scenes of a process: beside those of pilots, or of a render
    # before, kernels are others, and so are last bits
    gc.collect()
    estimate.run(stop, job.progress(0.05, 0.98))
    job.part_over("passes")
    after = method.after(estimate) | ({"text": taken.text(), "choice": taken.table} if taken else {})
    after["layers"] = (after.get("layers") or {}) | {DEPTH: world.depth(method.entry)}
    if taken and taken.approximations:
        after["bias"] = max(after.get("bias") or 0.0, taken.approximations)
    denoised, remarks = (None, []) if world.dark else _denoised(scene.values, quality, method, estimate)
    if denoised is not None:
        job.part_over("denoising")
    return estimate.finish(job, method=method.name, reasons=[*reasons, *after.pop("reasons", ()), *remarks], denoised=denoised,
                           **after)


def _denoised(values, quality, method, estimate):
    """The picture without its noise, or None where that stays, and sentences."""
    if not all(mean.count for mean in estimate.means.values()):
        return None, []  # interrupted before there was a picture
    filters, sentences = denoise.chosen(values, quality, _shared(estimate))
    if not filters:
        return None, sentences
    if method.features is None and set(estimate.means) <= set(method.apart):
        return None, [f"the noise is not taken out: a filter takes the detail of method {method.name} for noise"]
    parts = {name: (mean.layers[""], _variance(mean)) for name, mean in estimate.means.items()}
    made = denoise.denoised(parts, [name for name in parts if name in method.apart], method.features and method.features())
    return made, [*sentences, denoise.sentence(made.figures)]


def _variance(mean):
    """(H, W, 3) as far as so few passes tell it; None after one."""
    return None if mean.variance is None else mean.variance[..., :3] * student([1.0], [mean.count]) ** 2


def _shared(estimate) -> str:
    """That pixels share their noise, which a filter takes for picture, in words; "" where they do not."""
    if estimate.noise is None:
        return ""
    grey = estimate.rgb[..., 0]
    independent = math.sqrt(tiled(grey).size / grey.size) * student([1.0], [min(mean.count for mean in estimate.means.values())])
    if estimate.noise_region <= (reached.SHARED + independent) * estimate.noise:
        return ""
    return (f"pixels share it, so that it looks like the picture (means of regions have a noise of "
            f"{percent(estimate.noise_region)}, pixels {percent(estimate.noise)})")
