"""The emitters of a Mitsuba scene: their names, whether any shines, and what no renderer can make a picture of."""

import math

import mitsuba as mi
import numpy as np

from bakery.errors import UsageError

DARK = "nothing in the scene shines: its picture is black"  # what is said of such a scene
_LOOKS = 4181  # light samples that tell of lights, by a Fibonacci lattice
LATTICE = np.stack([(np.arange(_LOOKS) + 0.5) / _LOOKS, np.arange(_LOOKS) * (math.sqrt(5) - 1) / 2 % 1], axis=1)
_EVENLY = 0.25  # samples that go to all lights alike, over those that go by what lights bring: some bring more elsewhere
# parameters by which an emitter's light goes, before the dot of `.value`, `.data` and the like
_STRENGTHS = ("radiance", "intensity", "irradiance", "data", "scale", "texture")


def names_of(emitters) -> tuple[str, ...]:
    """Names of emitters, all different: their id, that of their shape, or their kind."""
    names: list[str] = []
    for emitter in emitters:
        shape = emitter.get_shape()
        name = plain = emitter.id() or (shape.id() if shape is not None else "") or emitter.class_name()
        count = 1
        while name in names:
            count += 1
            name = f"{plain}{count}"
        names.append(name)
    return tuple(names)


def shines(emitter) -> bool:
    """Whether none of an emitter's strengths is 0 everywhere."""
    return all(np.any(values) for key, values in _parameters(emitter) if _is_strength(key, values))


def dark(scene) -> bool:
    """Whether nothing shines in a scene of Mitsuba."""
    return not any(map(shines, scene.emitters()))


def favour(world, point) -> None:
    """Has a `world.World` draw its lights about as often as goes with what they bring to points (n, 3) m, unless its file weighs
    them itself: half of all samples went to a sky that brings next to nothing beside a bulb."""
    emitters = world.scene.emitters()
    if len(emitters) < 2 or any(emitter.sampling_weight() != 1 for emitter in emitters):
        return
    # in the other order of its numbers those of one point are far apart
    sample = world.lights(point[np.arange(len(LATTICE)) * len(point) // len(LATTICE)], LATTICE[:, ::-1])
    brought = np.bincount(np.maximum(sample.light, 0), sample.radiance.sum(axis=1), len(emitters))
    if not brought.sum() > 0:
        return
    for emitter, share in zip(emitters, brought / brought.sum(), strict=True):
        parameters = mi.traverse(emitter)
        parameters["sampling_weight"] = float(share + _EVENLY / len(emitters))
        parameters.update()
    world.scene.parameters_changed()


def refuse(path, scene) -> None:
    """Raises UsageError where lights of a scene of Mitsuba are of no size, below 0, no numbers or scaled, with all of them.

    Mitsuba renders most of these black, without a word: its samples of a light without area or of negative radiance have no
    density, and pixels that are no numbers are dropped.  A sun whose transform scales is brighter by the scale.

    path : of the scene, for the message
    """
    emitters = scene.emitters()
    faults = [f"{path}: light {name}: {fault}" for name, emitter in zip(names_of(emitters), emitters)
              for fault in _faults(emitter)[:1]]
    if faults:
        raise UsageError("\n".join(faults))


def _faults(emitter):
    faults, shape = [], emitter.get_shape()
    for key, values in _parameters(emitter):
        name = key.removesuffix(".value")
        if not np.all(np.isfinite(values)):
            faults.append(f"{name} is {_shown(values, ~np.isfinite(values))}; expected finite numbers")
        elif _is_strength(key, values) and np.any(values < 0):
            faults.append(f"{name} is {_shown(values, values < 0)}; expected 0 and above")
        elif key == "cutoff_angle" and not np.all(values > 0):
            faults.append(f"{name} is {_shown(values, values <= 0)}; expected an angle above 0")
        elif key == "to_world" and mi.has_flag(emitter.flags(), mi.EmitterFlags.Infinite) and _scales(values):
            faults.append("its to_world scales, which changes its light; expected a rotation: take the scale out")
    if shape is not None and not (area := float(np.max(np.array(shape.surface_area())))) > 0:
        faults.append(f"its shape has an area of {area:g}; expected a shape of some size")
    return faults


def _scales(matrix) -> bool:
    """Whether a transform (16,) does more than turn, mirror and move: directions to suns and skies are no unit vectors then."""
    linear = matrix.reshape(4, 4)[:3, :3]
    return bool(np.max(abs(linear.T @ linear - np.eye(3))) > 0.01)


def _is_strength(key: str, values) -> bool:
    """Whether light goes by a parameter, and is none where it is 0.

    Where wavelengths are sampled, colours are coefficients of a curve, of any sign, times a spectrum that has the strength.
    """
    curve = mi.is_spectral and (key.endswith("data") or key.endswith(".value") and values.size > 1)
    return key.split(".")[0] in _STRENGTHS and not key.endswith((".to_uv", ".range")) and not curve


def _parameters(emitter):
    """Pairs of name and numbers (n,) of an emitter's parameters."""
    for key, value in mi.traverse(emitter).items():
        # not `matrix` alone: letters after the dot are columns of Dr.Jit's vectors
        transform = hasattr(value, "inverse_transpose")
        yield key, np.array(value.matrix if transform else value, float).ravel()


def _shown(values, wrong) -> str:
    """Values as a message says them: all of a few, of many the first wrong one and how many there are."""
    if len(values) <= 4:
        return " ".join(f"{value:g}" for value in values)
    return f"{values[wrong][0]:g} in {np.count_nonzero(wrong):,} of {len(values):,} places"
