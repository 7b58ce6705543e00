"""What a scene of separate particles needs of a recipe: how good their optics, at how many wavelengths."""

import math

import numpy as np

from renderers import colour
from renderers.materials.particles import seen
from renderers.materials.particles.declared import methods
from renderers.scene.budget import as_much, percent
from renderers.scene.requirements import Knob, Need

_RGB = (0.610, 0.550, 0.465)  # um, what `wavelengths: rgb` means
# Tolerance of the classes' averages over the difference that it makes to a picture in light that comes from many directions: 30 %
# makes 1.0 % in lamp_in_dust (`python benchmarks/requirements.py lamp_in_dust --pictures`); a margin of two
_FEWER = 14.0
# In light from one direction a particle shows its class at a single angle, where rings of interference are as large as the phase
# function: 5 % at one wavelength changes pictures of particles alone by 4.6 %, and a pixel by 10 %; half as much 3.6 and 6 %, a
# fifth 1.5 and 5 % (tests/adversarial.py).  Rings of L wavelengths fall on different angles: a root of L less
_ALONE = 0.33
_MOST, _LEAST = 0.3, 1e-3  # above 30 % nothing gets cheaper: classes have the fewest radii that they may have
_BINS = 36  # of the scattering angle
_EACH = math.sqrt(0.5)  # of the tables' share, for fewer wavelengths and for averages


def needs(about) -> list[Need]:
    """Requirements of the stages optics, medium and discrete; see `renderers.scene.requirements`."""
    settings = about.entry
    if about.recipe.particles is None:
        return [Need("discrete", True, "the renderer reads it")]
    sharp, fewer = about.measured(_sharp), _wavelengths(about)
    count = 3 if fewer else len(about.medium.wavelength)
    wanted = about.tables * (_ALONE * math.sqrt(count) / sharp if sharp else _FEWER * _EACH)
    value = float(np.clip(wanted, _LEAST, _MOST))
    text, why = f"{100 * value:.3g}%", about.share + \
        (f"; {percent(sharp)} of it are particles in light from one direction" if sharp else "")
    if about.dark:
        text, value, why = f"{100 * _MOST:g}%", _MOST, "nothing in the scene shines: its picture is black"
    tolerances = [Knob("tolerance", value, text, why, larger=False),
                  Knob("measure", "integrated", "integrated", "classes are held to the light as a whole",
                       words=("integrated", "pointwise"))]
    classes = [Knob("discrete.tolerance", value, text, why, larger=False)]
    if methods()[settings.method].continuous:  # the sum over the classes, however many
        classes.append(Knob("discrete.classes", 1, "1", f"method {settings.method} reads their sum"))
    lacking = "" if wanted >= _LEAST else f"averages of {100 * wanted:.2g} % are wanted; {100 * _LEAST:g} % is asked for, " \
                                          f"{as_much(_LEAST / wanted)}"
    return [Need("optics", True, "the stage discrete is held against it", (*tolerances, *fewer)),
            Need("medium", True, "the stage discrete is held against it"),
            Need("discrete", True, _apart(about), tuple(classes), lacking)]


# ---- light


def _sharp(about):
    """Share of the picture's light that particles scatter which are seen one by one in a light narrower than a step of the
    scattering angle; 0 where no light is, 1 where their box is not known."""
    if about.dark or methods()[about.entry.method].continuous:
        return 0.0
    box = _box(about)
    angles = about.world.light_angles(about.world.camera.origin if box is None else np.mean(box, axis=0))
    if np.min(angles) >= math.pi / _BINS:
        return 0.0
    return 1.0 if box is None else seen.share(about.world, about.medium, seen.Box(*box), 0.5 * about.camera.pixel)


# ---- wavelengths


def _wavelengths(about) -> tuple[Knob, ...]:
    """Red, green and blue in place of more, where that changes the light that is scattered once by less than tables may."""
    waves = np.asarray(about.medium.wavelength)
    if len(waves) <= 3 or not waves.min() <= min(_RGB) <= max(_RGB) <= waves.max():
        return ()
    change = about.measured(_of_three)
    if change > _EACH * about.tables:
        return ()
    return (Knob("wavelengths", 3, "rgb", f"three in place of {len(waves)} change light that is scattered once by "
                 f"{100 * change:.2g} %, and they may take {100 * _EACH * about.tables:.2g} %"),)


def _of_three(about):
    """Relative change of linear sRGB, the largest of the channels, of white light that is scattered once beyond half a pixel.

    Of means over some degrees, as particles of many sizes in the light of lamps are seen by.
    """
    medium, peak = about.medium, 0.5 * about.camera.pixel
    waves, three = np.asarray(medium.wavelength), np.array(_RGB)
    theta = medium.theta
    spectrum = (medium.sigma_t * medium.albedo)[:, None] * medium.phase  # (L, A)
    change = (colour.srgb_matrix(three) @ colour.interpolate(waves, three) - colour.srgb_matrix(waves)) @ spectrum
    whole = colour.srgb_matrix(waves) @ spectrum
    solid = np.where(theta > peak, -np.gradient(np.cos(theta)), 0.0)
    bins = np.minimum((theta / np.pi * _BINS).astype(int), _BINS - 1)
    changes, wholes = (np.array([np.bincount(bins, row * solid, _BINS) for row in rows]) for rows in (change, whole))
    return float(np.max(np.abs(changes).sum(axis=1) / np.abs(wholes).sum(axis=1)))


# ---- what can be told apart


def _apart(about):
    """How many particles a pixel sees, in words: by chance a pixel deviates from the continuous medium by one over the root.

    Pixels of the same brightness n particles of cross sections C deviate by sqrt(<C^2>/(n <C>^2)) (Campbell's theorem); with
    spheres C goes with r^2.  In `auto` the renderer decides by pixel, with lights (`renderers/materials/particles/detail.py`).
    """
    if about.dark:
        return "nothing in the scene shines: its picture is black"
    number, box = about.recipe.particles.number_density, _box(about)
    if number is None or box is None:
        return "the renderer reads it"
    lo, hi = box
    farthest = float(np.linalg.norm(np.maximum(abs(lo - about.world.camera.origin), abs(hi - about.world.camera.origin))))
    seen = number * about.camera.pixel**2 * farthest**3 / 3
    depth = float(np.max(about.medium.sigma_t)) * float((hi - lo).max())
    return f"a pixel sees {seen:.2g} particles up to {farthest:.3g} m, so that they " \
           f"{'can be told apart' if seen < 1 / (0.5 * about.tolerance) ** 2 else 'are told apart where they are near'}; " \
           f"optical depth {depth:.2g}"


def _box(about):
    """Corners (2, 3) m of the box that holds the particles; None where a file does."""
    where, box = about.entry.where, about.recipe.discrete and about.recipe.discrete.box
    if hasattr(where, "box"):
        return np.array([where.box.lo, where.box.hi])
    return np.array([[0, 0, 0], 1e-6 * np.array(box)]) if box and where is None else None
