"""Layers of other assets that lie under one, as arrays of its group."""

import math
from collections.abc import Iterable

import numpy as np

from bakery.stages.declaration import ANY, Output
from bakery.stages.surface.triangles import packed, unpacked
from bakery.store.tree import Group

INFINITE_DEPTH = -1.0  # how an infinite optical depth is stored
OUTPUTS = (
    Output("under_index", "(J,)", "1", "refractive index of each layer under this one, from the top, over that of the air",
           optional=True),
    Output("under_roughness", "(J,)", "1", "of the facets on top of each (GGX), 0: smooth; absent where all are smooth",
           optional=True, within=(0, 1)),
    Output("under_depth", "(L, J)", "1", "optical depth of each; -1: infinite", optional=True, within=(-1, math.inf)),
    Output("under_albedo", "(L, J)", "1", "single-scattering albedo of each", optional=True, within=(0, 1)),
    Output("under_peak", "(L, J)", "1", "share of the scattered light of each in a forward peak that the solver leaves out",
           optional=True, within=(0, 1)),
    Output("under_length", "(L, J)", "um", "mean free path of each; of one of depth 0 its thickness; absent in assets of former "
           "versions", optional=True),
    Output("under_theta", "(Q,)", "rad", "angles of their phase functions, 0: forward", optional=True, within=(0, math.pi)),
    Output("under_phase", "(L, J, Q)", "1/sr", "their phase functions, linear in the cosine in between", optional=True),
    Output("under_reflected", "(L, O, G)", "1", "Fourier orders of what lies under all of them and is counted among grains, "
           "times the sum of both cosines and, of odd orders, over both sines: at Gauss nodes of the root of the cosine, row by "
           "row of an upper triangle", optional=True, within=ANY),
    Output("mirrored", "(L, T, N)", "1", "share of the light from each direction that boundaries between layers mirror",
           optional=True, within=(0, 1)),
)
_APART = "under_length", "under_roughness", "under_reflected", "mirrored"
NAMES = tuple(output.path for output in OUTPUTS if output.path not in _APART)


def stored(slabs: list, solutions: list, shape: tuple[int, int]) -> dict:
    """Arrays of what lies under layers, T thicknesses of each of L wavelengths."""
    from bakery.physics.medium.phase import phase_at
    from bakery.physics.surfaces.slab import Reflector, layers

    firsts = range(0, len(slabs), shape[1])
    stacks, bottoms = zip(*(layers(slabs[first]) for first in firsts), strict=True)
    below = [stack[1:] for stack in stacks]
    theta = np.unique(np.concatenate([[0.0, math.pi], *(part.theta for stack in below for part in stack)]))
    values = {"under_index": np.array([part.index for part in below[0]]),
              "under_albedo": np.array([[part.albedo for part in stack] for stack in below]),
              "under_depth": np.array([[INFINITE_DEPTH if part.depth == math.inf else part.depth for part in stack]
                                       for stack in below]),
              "under_length": np.array([[part.length for part in stack] for stack in below]),
              "under_peak": np.array([[cut.share for cut in solutions[first].cuts[1:]] for first in firsts]),
              "under_theta": theta, "under_phase": np.array([[phase_at(part.theta, part.phase, theta) for part in stack]
                                                               for stack in below])}
    values = {name: value.reshape(len(below), 0, *value.shape[2:]) if not below[0] and name != "under_index" else value
              for name, value in values.items() if below[0]}
    if any(part.roughness > 0 for part in below[0]):
        values["under_roughness"] = np.array([part.roughness for part in below[0]])
    if isinstance(bottoms[0], Reflector):
        values["under_reflected"] = np.stack([packed(bottom.orders, len(bottom.orders)) for bottom in bottoms]).astype(np.float32)
    elif bottoms[0] is not None:
        values["base"] = np.array([float(bottom) for bottom in bottoms])
    return values | {"mirrored": np.array([solution.mirrored for solution in solutions]).clip(0, 1).reshape(*shape, -1)}


def rebuilt(group: Group, k: int):
    """What lies under a layer at wavelength number k, from the arrays: a `Slab` or a `Reflector`; None if nothing is stored."""
    from bakery.physics.surfaces.slab import Reflector, Slab

    bottom, base = None, float(group["base"].data[k]) if "base" in group.members else None
    if "under_reflected" in group.members:
        triangles = np.asarray(group["under_reflected"].data[k], float)
        bottom = Reflector(unpacked(triangles, int((math.sqrt(1 + 8 * triangles.shape[1]) - 1) / 2)))
    if "under_index" not in group.members:
        return bottom
    theta, index = np.asarray(group["under_theta"].data, float), group["under_index"].data
    roughness = group["under_roughness"].data if "under_roughness" in group.members else np.zeros(len(index))
    length = group["under_length"].data if "under_length" in group.members else np.full_like(group["under_depth"].data, math.nan)
    for j in range(len(index))[::-1]:
        depth, albedo, last = float(group["under_depth"].data[k, j]), float(group["under_albedo"].data[k, j]), bottom is None
        bottom = Slab(theta, np.asarray(group["under_phase"].data[k, j], float), albedo,
                      math.inf if depth == INFINITE_DEPTH else depth, float(index[j]), base if last else None,
                      float(roughness[j]), bottom, float(length[k, j]))
    return bottom


def _is_free(group: Group) -> bool:
    """Whether air is below the layer, or below those under it."""
    last = group["under_depth"].data[:, -1] == INFINITE_DEPTH if "under_depth" in group.members else False
    return "depth" in group.members and not ({"base", "under_reflected"} & group.members.keys() or np.all(last))


def sound(group: Group) -> Iterable[str]:
    """Whether an infinite layer is the last, a base is under rough boundaries, and what boundaries mirror is there."""
    indices = [1.0, *group["index"].data, *(group["under_index"].data if "under_index" in group.members else ())]
    rough = [*group["roughness"].data, *(group["under_roughness"].data if "under_roughness" in group.members else ())]
    if any(np.diff(indices[:len(rough) + 1])[np.array(rough) > 0]) and _is_free(group):
        yield "base missing under a rough boundary"
    if "mirrored" not in group.members and {"under_index", "under_reflected"} & group.members.keys():
        yield "mirrored missing"
    if "under_index" in group.members:
        depth, theta = group["under_depth"].data, group["under_theta"].data
        if ((depth < 0) & (depth != INFINITE_DEPTH)).any() or (depth[:, :-1] < 0).any():
            yield "under_depth is below 0 where no infinite layer ends the stack"
        if theta[0] != 0 or abs(theta[-1] - math.pi) > 1e-9 or not (np.diff(theta) > 0).all():
            yield "under_theta does not ascend from 0 to pi"
        if (group["under_index"].data < 1).any():
            yield "under_index is below 1"
    if "under_reflected" in group.members:
        count = group["under_reflected"].data.shape[-1]
        if int((math.sqrt(1 + 8 * count) - 1) / 2) * int((math.sqrt(1 + 8 * count) + 1) / 2) != 2 * count:
            yield "under_reflected does not hold one value a pair of directions"
