"""The methods of a scene: which passes make its picture, and what is to be said of them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from renderers.granular import material, medium, paths
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
    asset, (vertices, faces) = job.asset, material.mesh_of(job.scene)
    grains = material.grains_of(asset, vertices, faces)
    aggregate, unit, name = grains.aggregate, grains.unit, job.scene.values.granular.method
    around = material.occupied_by(world, aggregate, unit), material.colours_of(asset)
    if name == "ept":
        how, reasons = paths.Explicit(grains, *around), _reasons(asset)
    else:
        how, reasons = medium.Continuous(material.medium_of(asset, aggregate, unit), *around), _reasons_of_medium(asset)
    return Method((Part(name, _pass(world, how, seed)),), reasons, {"grains": _expected(aggregate, vertices / unit, faces)})


def _pass(world, how, seed):
    """A pass as `Part` takes it: its number -> layers."""
    lights, (height, width) = world.light_names, world.size

    def one(number):
        by_order, by_light = paths.one_pass(world, how, world.camera, height, width, number, seed, lights=len(lights))
        return {"": by_order.sum(axis=0)} | dict(zip(_LAYERS, by_order)) \
            | {f"light.{name}": image for name, image in zip(lights, by_light)}

    return one


def _reasons(asset):
    surfaces = [one.surface for one in asset.grains.exemplars.values()]
    said = []
    if any(one["type"] == "dielectric" and len(set(one["index"])) > 1 for one in surfaces):
        said.append("grains refract all wavelengths as the middle one")
    if any(one["type"] != "diffuse" and one["roughness"] == 0 for one in surfaces):
        said.append("light reaches smooth grains by chance: lights without extent do not show in them")
    return said


def _reasons_of_medium(asset):
    said = ["the medium that stands for the grains: no grain is to be seen"]
    if any(one.surface["type"] != "dielectric" for one in asset.grains.exemplars.values()):
        said.append("packed opaque grains reflect more than a medium, dark ones twice as much (docs/granular.md)")
    return said


def _expected(aggregate, vertices, faces):
    """Number of spheres in the mesh's volume."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    volume = float(np.sum(a * np.cross(b, c))) / 6
    return volume * len(aggregate.radii) / float(np.prod(aggregate.cell))
