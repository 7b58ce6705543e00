"""What has to be known of a sequence before its first frame is rendered: its frames, checked, with assets and method."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Sequence as Several
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import NamedTuple

import numpy as np

import bakery
from bakery.errors import Problem, RecipeError, UsageError
from renderers import assets, choice, denoise, running, scene
from renderers.frames import NOISE
from renderers.progressive import fingerprint, made_of
from renderers.sequence import outputs

_LIBRARIES = ("mitsuba", "drjit", "numba", "numpy", "scipy", denoise.PACKAGE)


class Frame(NamedTuple):
    """A frame that is to be there.

    Attributes
    ----------
    number : from 1
    scene : `renderers.scene.Scene` with its assets, its choice of method and its mark
    pair : paths (PNG, EXR)
    options : quality, variant, seed, as the renderer takes them
    """

    number: int
    scene: scene.Scene
    pair: tuple[Path, Path]
    options: dict


class Sequence(NamedTuple):
    """Frames that were asked for.

    Attributes
    ----------
    path, settings : of the scene, and dotted key -> text of what was set by hand
    frames : of `Frame`
    output : `X.png` or `X.exr`
    rate : frames a second
    noise : same or fresh random numbers in each frame
    overwrite : replace also files of another kind
    remarks : sentences
    """

    path: Path
    settings: dict[str, str]
    frames: tuple[Frame, ...]
    output: Path
    rate: float
    noise: str
    overwrite: bool
    remarks: tuple[str, ...]


def of(path, output, numbers: Several[int] | None, *, overrides, options, overwrite, progress, measured: int) -> Sequence:
    """Checks all frames of a scene, sees to their assets and decides by which method they are rendered.

    numbers : of the frames that are asked for; all if None
    options : dict of quality, variant and seed, where they are given
    measured : how many frames say what an asset has to hold

    Raises RecipeError with the problems of all frames, UsageError where there is no such frame or a picture cannot be written.
    """
    settings = dict(overrides or {})
    quality, variant, seed = (options.get(name) for name in ("quality", "variant", "seed"))
    loaded = _loaded(path, settings, numbers)
    section = loaded[0].values.frames
    numbers = tuple(range(1, section.count + 1)) if numbers is None else tuple(numbers)
    asked = [loaded[number - 1] for number in numbers]
    output = Path(output or loaded[0].picture)
    pairs = outputs.pairs(output, numbers, {file: None for frame in loaded for file in frame.inputs}, overwrite)
    running.refuse_too_large(loaded[0])
    for frame in asked:
        denoise.refuse_absent(frame)
    remarks = _measured_in(loaded, measured)
    loaded = assets.together(loaded, progress, _spread(len(loaded), measured))
    with progress.during("method"):
        taken = _choice(loaded, quality, variant)
    marks, frames = _Marks(quality, _variant(variant)), []
    for number, pair in zip(numbers, pairs):
        shot, own_seed = loaded[number - 1], _seed(seed, section.noise, number)
        shot = dataclasses.replace(shot, choice=taken if choice.candidates(shot) else None)
        shot = dataclasses.replace(shot, mark=marks.of(shot, own_seed))
        frames.append(Frame(number, shot, pair, {"quality": quality, "variant": variant, "seed": own_seed}))
    remarks += [f"{taken.sentence}; decided in frame 1, for all frames"] if taken else []
    return Sequence(Path(path), settings, tuple(frames), output, section.rate, section.noise, overwrite, tuple(remarks))


def _loaded(path, settings, numbers) -> list:
    """Every frame of a scene: also those that are not asked for say what assets have to hold."""
    count = scene.frames_of(path, settings).count
    if numbers and count and numbers[-1] > count:
        raise UsageError(f"--frames: found frame {numbers[-1]}; {path} has frames 1 to {count} (frames.count)")
    loaded, wrong = [], {}
    for number in range(1, max(count, 1) + 1):
        try:
            loaded.append(scene.load(path, settings, frame=number))
        except RecipeError as fault:
            wrong[number] = fault.problems
    if wrong:
        raise RecipeError(_described(wrong, max(count, 1)))
    return loaded


def _described(wrong: dict[int, list[Problem]], count: int) -> list[Problem]:
    """The problems of all frames; of one place those of the first frame that has any there, and in how many there are some."""
    frames: dict[tuple, list[int]] = {}
    told: dict[tuple, list[Problem]] = {}
    for number, problems in wrong.items():
        for problem in problems:
            spot = problem.file, problem.line, problem.column, problem.key
            if number not in frames.setdefault(spot, []):
                frames[spot].append(number)
            if frames[spot] == [number]:
                told.setdefault(spot, []).append(problem)
    return [problem if _same(problem, frames[spot], wrong, count) else
            dataclasses.replace(problem, found=f"{problem.found}, in frame {frames[spot][0]}{_others(len(frames[spot]) - 1)}")
            for spot, problems in told.items() for problem in problems]


def _same(problem, numbers, wrong, count: int) -> bool:
    """Whether a problem is that of every frame, in the same words."""
    return len(numbers) == count and all(problem in wrong[number] for number in numbers)


def _others(count: int) -> str:
    return f" and {count} other{'s' * (count > 1)}" if count else ""


def _spread(count: int, most: int) -> list[int]:
    """Positions of some of so many frames, the first and the last among them."""
    return sorted(set(np.linspace(0, count - 1, min(most, count)).round().astype(int).tolist()))


def _measured_in(loaded, most: int) -> list[str]:
    """What is to be said where not every frame says what the bake of a recipe has to hold."""
    if len(loaded) <= most or not any(assets.recipe_of(loaded[0], entry)[0] for entry in loaded[0].materials):
        return []
    numbers = ", ".join(str(position + 1) for position in _spread(len(loaded), most))
    return [f"frames {numbers} say what the assets of all frames have to hold"]


def _choice(loaded, quality, variant):
    """The choice of the first frame whose method chooses: all frames are rendered alike, or one would stand out."""
    first = next((frame for frame in loaded if choice.candidates(frame)), None)
    return first and choice.of_scene(first, quality, variant)


def _seed(seed, noise: str, number: int):
    """Of a frame; None where nobody gave one and none is needed."""
    return seed if noise == NOISE[0] else (seed or 0) + number


def _variant(variant) -> str:
    from renderers.mitsuba import variants

    return variant or variants.choose("rgb").names[0]


def versions() -> dict[str, str]:
    """Of what decides the bytes of a picture."""
    return {"bakery": bakery.__version__} | {name: _version(name) for name in _LIBRARIES}


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return ""


class _Marks:
    """What tells a frame from others: the hash of all that its pictures depend on."""

    def __init__(self, quality, variant: str):
        self._common = quality or "final", variant, versions()
        self._files: dict[Path, str] = {}
        self._assets: dict[Path, str] = {}

    def of(self, shot, seed) -> str:
        told, *files = made_of(shot)
        shown = shot.values.model_dump(mode="json", include={"stop", "display", "denoise"}, warnings=False)
        return fingerprint(told, shown, [self._file(file) for file in files], [self._asset(file) for file in shot.assets],
                           shot.share, shot.choice and shot.choice.method, seed or 0, *self._common)

    def _file(self, path: Path) -> str:
        if path not in self._files:
            self._files[path] = hashlib.sha256(path.read_bytes()).hexdigest()
        return self._files[path]

    def _asset(self, path: Path) -> str:
        if path not in self._assets:
            self._assets[path] = bakery.open(path).content_hash
        return self._assets[path]
