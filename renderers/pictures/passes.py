"""Scenes whose pictures are sums of passes, from their files to their reports: what is alike for separate particles, grains and
translucent bodies.

Each of these renderers has a `prepare`, which makes a `Method` of a scene.
"""

import dataclasses
import gc
import math
from collections.abc import Callable
from contextlib import nullcontext
from typing import NamedTuple

import numpy as np

from bakery.run import ahead
from renderers import choice, seeds
from renderers.mitsuba import variants
from renderers.mitsuba.lights import DARK
from renderers.pictures import denoise, images, reached, running
from renderers.pictures.engine import in_time
from renderers.pictures.means import student, tiled
from renderers.pictures.progressive import Estimate, Part, Stop, fingerprint, made_of
from renderers.pictures.running import Render
from renderers.scene import budget, candidates, entries, meshes
from renderers.scene.budget import percent

LENS = "the camera has a lens, which is left out: it is a pinhole, and all is in focus"
DEPTH = "depth.Z"  # channel of the EXR: along the camera's axis, m, as other programs composite by


class Method(NamedTuple):
    """How a scene is rendered.

    name : of the method
    parts : of the picture
    reasons : sentences
    after : function of the `Estimate` after the last pass, what `Estimate.finish` gets: layers, bias, figures of the renderer;
        further reasons
    approximations : error of the method as it was measured in this scene; None: what the renderer states
    features : function of a quality, as `render` takes it, which gives the `renderers.pictures.denoise.Features` of the scene, of
        a draft by fewer rays; None: nothing does
    apart : names of parts whose detail looks like noise: they are not filtered
    entry : what `World.depth` takes: to what hides surfaces and is none of the Mitsuba scene; None: nothing does
    unmeasured : whether it is also off by what no comparison of methods tells
    """

    name: str
    parts: tuple[Part, ...]
    reasons: list[str]
    after: Callable[[Estimate], dict]
    approximations: float | None = None
    features: Callable[[str | None], denoise.Features | None] | None = None
    apart: tuple[str, ...] = ()
    entry: Callable | None = None
    unmeasured: bool = False


def render(scene, output=None, *, overrides=None, quality=None, variant=None, seed=None, progress=None, overwrite=False,
           resume=False, elsewhere=None) -> dict:
    """Renders a scene of materials to a PNG and an EXR file beside each other.

    Parameters
    ----------
    scene : path of the scene, or what `renderers.scene.load` made of it
    output : `X.png` or `X.exr`, both are written; beside the scene, by its name, if None
    overrides : dotted key -> value as text, such as `{"materials[0].method": "vpt"}`; of a path
    quality : draft, preview or final: noise, time and samples by the scene's `stop`
    variant : of Mitsuba, one for colours on arrays
    seed : of the passes, a whole number from 0 to 2^64 - 1; 0 if None
    progress : function of (fraction 0 to 1, noise or None)
    overwrite : replace also files that are no such pictures; never one that the scene reads
    resume : go on with the passes in the EXR file
    elsewhere : function of the `Rendering` whose context is what renders its passes: `renderers.cluster.passes.workers(cluster)`;
        None: this process does

    Returns
    -------
    report : that of `renderers.pictures.progressive`; of particles with `particles` (number, or the expected one),
        `optical_depth` (of the region's longest edge, smallest and largest wavelength's) and `as_particles` (share of the pixels
        that show any as particles), of grains with `grains` (expected number)

    Raises
    ------
    RecipeError : with every problem of the scene
    UsageError, AssetError : a file is not what it should be; the text says which and why
    Interrupted : after what is there was written

    Notes
    -----
    EXR layers: order0 (light that no material scattered), order1, order2, orders (three events and more; a grain counts once
    however often light meets its surface), light.NAME (from each light), noise (standard error), depth.Z.  Of particles detail
    (m, depth up to which they are particles) and method (0: continuous, 1: particles, 2: both); of grains by several techniques
    ept, vpt, da, what each has brought, and switch (grains that paths have met when they switch); of bodies by beams
    closer_even and closer_odd (what it would change if pixels shared light over half the distance, of every other pass) and
    sharper (if beams of lights without extent were half as wide; sharper_even, sharper_odd: those of methods by beams); of
    several materials material (the entry in which most paths of the pixel first scattered; -1: none).
    """
    seed = seeds.checked(seed)  # before anything is baked
    rendering = Rendering(Render(scene, output, overrides=overrides, quality=quality, overwrite=overwrite, progress=progress),
                          variant, seed, resume)
    with elsewhere(rendering) if elsewhere else nullcontext() as draw:
        rendering.run(draw=draw)
    return rendering.finish()


def pace_of(scene, quality) -> float | None:
    """Seconds by which the size of passes goes (`engine.in_time`); None: they are whole."""
    return None if scene.whole else reached.limit(scene.values.stop.time, quality)


def describe(report) -> list[str]:
    """Lines for people."""
    if report["renderer"] != "mixed":
        return running.describe(report)
    entries = (f"materials[{number}] {entry['kind']} by {entry['method']}" for number, entry in enumerate(report["materials"]))
    return [*running.describe(report), ", ".join(entries)]


class Rendering:
    """A scene whose method is chosen and prepared.

    job : `renderers.pictures.running.Render`
    method : `Method`
    estimate : `Estimate`, the passes so far
    stop : `Stop`, what ends them
    reasons : sentences, how the method was chosen and what it leaves out
    seed : of the passes
    denoised : `renderers.pictures.denoise.Denoised` of the picture that was written, None where there is none
    """

    def __init__(self, job, variant=None, seed=None, resume=False, begins=None):
        """
        job : the scene, as `renderers.pictures.running.Render`
        variant, seed, resume : as `render` takes them
        begins : function of the name of a part that begins: `choice` of the method, `preparation`; None: nobody asks
        """
        self.job, self.seed, scene = job, seeds.checked(seed), job.scene
        begins = begins or (lambda name: None)
        try:
            self._prepare(scene, variant, resume, begins)
        except variants.SeveralScenes:
            if variant is not None:
                raise
            self._prepare(scene, "llvm_ad_rgb", resume, begins)
            self.reasons.append(f"rendered on the processor: {variants.SEVERAL_SCENES}")
        self.denoised = None
        # Dr.Jit compiles a call for the surfaces and lights of all scenes of a process: beside those of pilots, or of a render
        # before, kernels are others, and so are last bits
        gc.collect()

    def _prepare(self, scene, variant, resume, begins):
        self._world = world = meshes.world_of(scene, variant)
        if world.camera is None:
            raise scene.no_camera()
        images.refuse_too_large(scene.path, *world.size)
        self.job.part_over("scene")
        begins("choice")
        opened = choice.Opened(scene, self.job.assets, self.job.asset)
        earlier = self.job.pair[1] if resume else None
        self._taken = taken = scene.choice or choice.chosen(opened, world, self.job.quality, earlier)
        if taken is not None:
            self.job.part_over("choice")
            self.job.scene = dataclasses.replace(candidates.by_methods(scene, taken.methods), choice=taken)
            if scene.choice is None:  # chosen by this process, and not by one whose workers draw
                ahead.expect(ahead.of_scene(self.job.scene), now=True)
        begins("preparation")
        self.method = self.job.scene.prepare(self.job, world, self.seed)
        world.forget()
        self.job.part_over("preparation")
        identity = {"scene": fingerprint(*made_of(scene)), "seed": self.seed, "size": list(world.size),
                    "asset": [asset.content_hash for asset in self.job.assets]}
        parts = in_time(self.method.parts, pace_of(self.job.scene, self.job.quality))
        self.estimate = Estimate(parts, identity)
        if resume:
            self.estimate.resume(self.job.pair[1])
        self._discoloured = discoloured(self.job.scene, self.job.assets, world)
        self.stop, self.reasons = self._stop()
        self.reasons += self._discoloured

    def _stop(self):
        """What ends the passes, and sentences."""
        values, taken, method = self.job.scene.values, self._taken, self.method
        if self._world.dark:
            # no pass will find anything by chance; the picture has its layers all the same
            return Stop(samples=1), [DARK]
        measured = method.approximations if taken is None or taken.approximations is None else taken.approximations
        split = budget.of(self.job.scene, approximations=measured)
        stop = Stop.of(split, values.measure, time=values.stop.time, samples=values.stop.samples, quality=self.job.quality)
        reasons = [*(taken.reasons if taken else []), *method.reasons, *split.lacking, *self._world.media(),
                   *meshes.doubts(self.job.scene, self._world), *_hidden_grains(self.job.scene, self.job.assets)]
        return stop, reasons + [LENS] * self._world.lens

    @property
    def variant(self) -> str:
        """Of Mitsuba."""
        return self._world.variant

    def run(self, observer=None, draw=None):
        """Renders passes; observer, draw : as `renderers.pictures.engine.Passes.run` takes them."""
        self.estimate.run(self.stop, self.job.progress(0.05, 0.98), observer, draw)

    def cleared(self, features=None):
        """The picture so far as `renderers.pictures.denoise.Denoised`, None where its noise stays, and sentences.

        features : as of a `Method`
        """
        if self._world.dark:
            return None, []
        return _denoised(self.job.scene.values, self.job.quality, self.method, self.estimate, features)

    def finish(self) -> dict:
        """Writes the pictures, and reports as `render` does."""
        self.job.part_over("passes")
        taken = self._taken
        after = self.method.after(self.estimate) | ({"text": taken.text(), "choice": taken.table} if taken else {})
        depth = self._world.depth(self.method.entry)
        after["layers"] = (after.get("layers") or {}) | {DEPTH: depth}
        if taken and "materials" in after:
            after["materials"] = taken.of_entries(after["materials"])
        measured = after.get("bias") is not None or not after.get("left_out")
        if taken and taken.approximations and measured and not self.method.unmeasured:
            after["bias"] = max(after.get("bias") or 0.0, taken.approximations)
        if self._discoloured:
            after["bias"] = None
        self.denoised, remarks = self.cleared(self.method.features)
        if self.denoised is not None:
            self.job.part_over("denoising")
        return self.estimate.finish(self.job, method=self.method.name, denoised=self.denoised,
                                    reasons=[*self.reasons, *after.pop("reasons", ()), *_clipped(depth, *self._world.clip),
                                             *remarks], **after)


def discoloured(scene, assets, world) -> list[str]:
    """A sentence where the wavelengths of the assets that paths enter hold colours of lights and surfaces worse than the scene's
    tolerance."""
    from renderers.mitsuba import tints

    wavelengths = {tuple(np.asarray(asset.wavelength, float)) for entry, asset in zip(scene.materials, assets, strict=True)
                   if not entries.is_surface(entry.kind, entry.method)}
    if world.dark or len(wavelengths) != 1 or scene.values.film.wavelengths == "rgb":
        return []
    (wavelength,) = wavelengths
    share = tints.lost(world, np.array(wavelength))
    if share <= (scene.values.tolerance or budget.DEFAULT):
        return []
    end = "the picture is grey" if len(wavelength) == 1 else f"they are off by up to {percent(share)}"
    return [f"colours of lights and surfaces are not kept at the asset's wavelengths ({len(wavelength)}): {end}, and the bias is "
            "not known; wavelengths: rgb in the recipe keeps them"]


def _hidden_grains(scene, assets) -> list[str]:
    """Sentences on entries whose assets hold grains, and which are media or bodies by their places."""
    return [f"materials[{number}] is {entries.KINDS[entry.kind]} of the medium that stands for the grains of its asset: no grain "
            "is to be seen; where: {mesh: FILE} fills a mesh with grains"
            for number, (entry, asset) in enumerate(zip(scene.materials, assets, strict=True))
            if entry.kind in ("body", "medium") and "grains" in asset.stages and not entries.is_surface(entry.kind, entry.method)]


def _clipped(depth, near, far) -> list[str]:
    """A sentence where Mitsuba would show something else: first surfaces (H, W), m ahead, are beyond its clipping planes."""
    share = float(np.mean((depth < near) | np.isfinite(depth) & (depth > far)))
    return [f"the sensor's clipping planes, {near:.3g} m and {far:.3g} m ahead, are left out: what {percent(share)} of the "
            "pixels show first is beyond them"] if share > 0 else []


def _denoised(values, quality, method, estimate, features):
    """The picture without its noise, or None where that stays, and sentences."""
    if not all(mean.count for mean in estimate.means.values()):
        return None, []  # interrupted before there was a picture
    filters, sentences = denoise.chosen(values, quality, _shared(estimate))
    if not filters:
        return None, sentences
    if method.features is None and set(estimate.means) <= set(method.apart):
        return None, [f"the noise is not taken out: a filter takes the detail of method {method.name} for noise"]
    parts = {name: (mean.layers[""], mean.variance) for name, mean in estimate.means.items()}
    widened = {name: student([1.0], [mean.count]) for name, mean in estimate.means.items() if mean.variance is not None}
    smoothed = denoise.denoised(parts, [name for name in parts if name in method.apart], features and features(quality), widened,
                                quick=quality == "draft")
    return smoothed, [*sentences, denoise.sentence(smoothed.figures)]


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
