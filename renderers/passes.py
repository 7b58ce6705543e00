"""Scenes whose pictures are sums of passes, from their files to their reports: what is alike for separate particles, grains and
translucent bodies.

Each of these renderers has a `prepare`, which makes a `Method` of a scene.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from renderers import budget, images
from renderers.mitsuba.world import World
from renderers.progressive import Estimate, Part, Stop, fingerprint, made_of
from renderers.running import Render


class Method(NamedTuple):
    """How a scene is rendered.

    Attributes
    ----------
    name : of the method
    parts : of the picture
    reasons : sentences
    after : function of the `Estimate` after the last pass, what `Estimate.finish` gets: layers, bias, figures of the renderer
    """

    name: str
    parts: tuple[Part, ...]
    reasons: list[str]
    after: Callable[[Estimate], dict]


def render(prepare, path, output, *, overrides=None, quality=None, variant=None, seed=None, progress=None, overwrite=False,
           resume=False) -> dict:
    """Renders a scene; parameters, report and errors beyond these are those of `render` of its renderer.

    prepare : function of (`renderers.running.Render`, World, seed) -> Method
    """
    job = Render(path, output, overrides=overrides, overwrite=overwrite, progress=progress)
    scene, wanted, seed = job.scene, job.scene.values.stop, seed or 0
    world = World.of(scene, variant)
    if world.camera is None:
        raise scene.no_camera()
    images.refuse_too_large(scene.path, *world.size)
    job.part_over("scene")
    method = prepare(job, world, seed)
    job.part_over("preparation")
    estimate = Estimate(method.parts, {"scene": fingerprint(*made_of(scene)), "seed": seed, "size": list(world.size),
                                       "asset": [asset.content_hash for asset in job.assets]})
    if resume:
        estimate.resume(job.pair[1])
    stop = Stop.of(budget.of(scene), scene.values.measure, time=wanted.time, samples=wanted.samples, quality=quality)
    estimate.run(stop, job.progress(0.05, 0.98))
    job.part_over("passes")
    return estimate.finish(job, method=method.name, reasons=method.reasons, **method.after(estimate))
