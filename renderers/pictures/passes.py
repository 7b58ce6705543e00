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
    rendering = Rendering(prepare, Render(path, output, overrides=overrides, quality=quality, overwrite=overwrite,
                                          progress=progress), variant, seed, resume)
    rendering.run()
    return rendering.finish()


class Rendering:
    """A scene whose method is chosen and prepared.

    Attributes
    ----------
    job : `renderers.pictures.running.Render`
    method : `Method`
    estimate : `Estimate`, the passes so far
    stop : `Stop`, what ends them
    reasons : sentences, how the method was chosen and what it leaves out
    denoised : `renderers.pictures.denoise.Denoised` of the picture that was written, None where there is none
    """

    def __init__(self, prepare, job, variant=None, seed=None, resume=False, begins=None):
        """
        Parameters
        ----------
        prepare, variant, seed, resume : as `render` takes them
        job : the scene
        begins : function of the name of a part that begins: `choice` of the method, `preparation`; None: nobody asks
        """
        begins = begins or (lambda name: None)
        self.job, scene, seed = job, job.scene, seed or 0
        self._world = world = World.of(scene, variant)
        if world.camera is None:
            raise scene.no_camera()
        images.refuse_too_large(scene.path, *world.size)
        job.part_over("scene")
        begins("choice")
        opened = choice.Opened(scene, job.assets, job.asset)
        self._taken = taken = scene.choice or choice.chosen(prepare, opened, world, job.quality, job.pair[1] if resume else None)
        if taken is not None:
            job.part_over("choice")
            job.scene = choice.with_method(scene, taken.method)
        begins("preparation")
        self.method = prepare(job, world, seed)
        job.part_over("preparation")
        identity = {"scene": fingerprint(*made_of(scene)), "seed": seed, "size": list(world.size),
                    "asset": [asset.content_hash for asset in job.assets]}
        self.estimate = Estimate(self.method.parts, identity)
        if resume:
            self.estimate.resume(job.pair[1])
        self.stop, self.reasons = self._stop()
        self.denoised = None
        # Dr.Jit compiles a call for the surfaces and lights of all scenes of a process: beside those of pilots, or of a render
        # before, kernels are others, and so are last bits
        gc.collect()

    def _stop(self):
        """What ends the passes, and sentences."""
        values, taken, method = self.job.scene.values, self._taken, self.method
        if self._world.dark:
            # no pass will find anything by chance; the picture has its layers all the same
            return Stop(samples=1), [DARK]
        measured = method.approximations if taken is None or taken.approximations is None else taken.approximations
        split = budget.of(self.job.scene, approximations=measured)
        stop = Stop.of(split, values.measure, time=values.stop.time, samples=values.stop.samples, quality=self.job.quality)
        return stop, [*(taken.reasons if taken else []), *method.reasons, *split.lacking]

    @property
    def variant(self) -> str:
        """Of Mitsuba."""
        return self._world.variant

    def run(self, observer=None):
        """Renders passes; observer : as `renderers.pictures.engine.Passes.run` takes it."""
        self.estimate.run(self.stop, self.job.progress(0.05, 0.98), observer)

    def cleared(self, features=None):
        """The picture so far as `renderers.pictures.denoise.Denoised`, None where its noise stays, and sentences.

        features : function that gives the `renderers.pictures.denoise.Features` of the scene, or None
        """
        if self._world.dark:
            return None, []
        return _denoised(self.job.scene.values, self.job.quality, self.method, self.estimate, features)

    def finish(self) -> dict:
        """Writes the pictures, and reports as `render` does."""
        self.job.part_over("passes")
        taken = self._taken
        after = self.method.after(self.estimate) | ({"text": taken.text(), "choice": taken.table} if taken else {})
        after["layers"] = (after.get("layers") or {}) | {DEPTH: self._world.depth(self.method.entry)}
        if taken and taken.approximations:
            after["bias"] = max(after.get("bias") or 0.0, taken.approximations)
        self.denoised, remarks = self.cleared(self.method.features)
        if self.denoised is not None:
            self.job.part_over("denoising")
        return self.estimate.finish(self.job, method=self.method.name, denoised=self.denoised,
                                    reasons=[*self.reasons, *after.pop("reasons", ()), *remarks], **after)


def _denoised(values, quality, method, estimate, features):
    """The picture without its noise, or None where that stays, and sentences."""
    if not all(mean.count for mean in estimate.means.values()):
        return None, []  # interrupted before there was a picture
    filters, sentences = denoise.chosen(values, quality, _shared(estimate))
    if not filters:
        return None, sentences
    if method.features is None and set(estimate.means) <= set(method.apart):
        return None, [f"the noise is not taken out: a filter takes the detail of method {method.name} for noise"]
    parts = {name: (mean.layers[""], _variance(mean)) for name, mean in estimate.means.items()}
    made = denoise.denoised(parts, [name for name in parts if name in method.apart], features and features())
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
