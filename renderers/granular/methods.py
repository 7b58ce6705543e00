"""The methods of a scene: which passes make its picture, and what is to be said of them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from renderers.granular import material, paths
from renderers.progressive import Part

_LAYERS = ("order0", "order1", "order2", "orders")


class Method(NamedTuple):
    """How a scene is rendered.

    parts : of `renderers.progressive`
    reasons : sentences
    figures : what the report says besides
    """

    parts: tuple
    reasons: list
    figures: dict


def prepare(job, world, seed) -> Method:
    """The method that a scene asks for; `job` is a `renderers.running.Render`, `world` the surfaces and lights around."""
    vertices, faces = material.mesh_of(job.scene)
    place = material.place_of(job.asset, world, vertices, faces)
    lights, (height, width) = world.light_names, world.size

    def one(number):
        by_order, by_light = paths.one_pass(world, place, world.camera, height, width, number, seed, lights=len(lights))
        return {"": by_order.sum(axis=0)} | dict(zip(_LAYERS, by_order)) \
            | {f"light.{name}": image for name, image in zip(lights, by_light)}

    expected = _expected(place.grains.aggregate, vertices / place.grains.unit, faces)
    return Method((Part("ept", one),), _reasons(job.asset), {"grains": expected})


def _reasons(asset):
    surfaces = [one.surface for one in asset.grains.exemplars.values()]
    said = []
    if any(one["type"] == "dielectric" and len(set(one["index"])) > 1 for one in surfaces):
        said.append("grains refract all wavelengths as the middle one")
    if any(one["type"] != "diffuse" for one in surfaces):
        said.append("light reaches shiny and clear grains by chance: lights without extent do not show in them")
    return said


def _expected(aggregate, vertices, faces):
    """Number of spheres in the mesh's volume."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    volume = float(np.sum(a * np.cross(b, c))) / 6
    return volume * len(aggregate.radii) / float(np.prod(aggregate.cell))
