"""What has to be known of a sequence before its first frame is rendered: its frames, checked, with assets and method."""

import dataclasses
import hashlib
from collections.abc import Iterable
from collections.abc import Sequence as Several
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

import bakery
from bakery.errors import Problem, RecipeError, UsageError
from bakery.store.outputs import FileKind, by_suffix, check_outputs, named
from renderers import choice, scene, seeds
from renderers.pictures import denoise, images, running
from renderers.pictures.progressive import fingerprint, made_of
from renderers.pictures.versions import versions
from renderers.scene import assets, candidates
from renderers.scene.frames import NOISE

_FILM = FileKind("film (MP4)", lambda head: head[4:8] == b"ftyp")
MEASURED = 3  # frames that say what an asset has to hold: the first, the last, and between
CHECKED = 500  # frames of sequences that are checked whole, a second for 100; of longer ones those that are asked for


class Frame(NamedTuple):
    """A frame that is to be there.

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


def of(path, output, numbers: Several[int] | None, *, overrides, options, overwrite, progress) -> Sequence:
    """Checks all frames of a scene, sees to their assets and decides by which method they are rendered.

    numbers : of the frames that are asked for; all if None
    options : dict of quality, variant and seed, where they are given

    Raises RecipeError with the problems of all frames, UsageError where there is no such frame or a picture cannot be written.
    """
    settings = dict(overrides or {})
    quality, variant, seed = (options.get(name) for name in ("quality", "variant", "seed"))
    first_seed = seeds.checked(seed)
    section, loaded = _loaded(path, settings, numbers)
    numbers = tuple(range(1, section.count + 1)) if numbers is None else tuple(numbers)
    first, asked = loaded[1], [loaded[number] for number in numbers]
    output = named(output, first.picture)
    pairs = pairs_of(output, numbers, {file: None for frame in loaded.values() for file in frame.inputs}, overwrite)
    running.refuse_too_large(first)
    for frame in asked:
        denoise.refuse_absent(frame)
    measured = _spread(section.count, MEASURED)
    first, *asked = assets.together([first, *asked], progress, [loaded[number] for number in measured])
    with progress.during("method"):
        taken = choice.of_scene(first, quality, variant)
    mark, frames = _marking(quality, variant_of(variant)), []
    for number, shot, pair in zip(numbers, asked, pairs):
        own_seed = seed if section.noise == NOISE[0] else first_seed + number
        shot = dataclasses.replace(shot, choice=taken if candidates.of(shot) or candidates.surfaces(shot) else None)
        shot = dataclasses.replace(shot, mark=mark(shot, own_seed))
        frames.append(Frame(number, shot, pair, {"quality": quality, "variant": variant, "seed": own_seed}))
    remarks = [f"frames {', '.join(map(str, measured))} say what the assets of all frames have to hold"] \
        if section.count > MEASURED and any(assets.recipe_of(first, entry)[0] for entry in first.materials) else []
    remarks += [f"{taken.sentence}; decided in frame 1, for all frames"] if taken else []
    return Sequence(Path(path), settings, tuple(frames), output, section.rate, section.noise, overwrite, tuple(remarks))


def pairs_of(output, numbers: Several[int], inputs: Iterable[Path], overwrite: bool) -> list[tuple[Path, Path]]:
    """Paths (PNG, EXR) of each frame, `X.0001.png` of `X.png`.

    Raises UsageError, as `images.output_pair`; of the film and the contact sheet too.
    """
    pair, inputs = images.output_pair(output, overwrite=True), list(inputs)
    frames = [tuple(path.with_name(f"{path.stem}.{number:04d}{path.suffix}") for path in pair) for number in numbers]
    others = list(beside(output).values()) if len(frames) > 1 else []
    check_outputs(by_suffix([path for pair in frames for path in pair] + others, {".mp4": _FILM}), inputs, overwrite)
    return frames


def beside(output) -> dict[str, Path]:
    """Paths of the film and of the contact sheet."""
    output = Path(output)
    return {"film": output.with_suffix(".mp4"), "sheet": output.with_name(f"{output.stem}.frames.png")}


def _loaded(path, settings, numbers):
    """The section `frames`, and number -> scene of each frame: those that are asked for, those that say what assets have to hold,
    and of short sequences all, so that a fault in the last one is told at once."""
    section = scene.frames_of(path, settings)
    count = max(section.count, 1)  # of a section with a fault the first frame says it
    if numbers and section.count and numbers[-1] > count:
        raise UsageError(f"--frames: found frame {numbers[-1]}; {path} has frames 1 to {count} (frames.count)")
    every = range(1, count + 1)
    loaded, wrong = {}, {}
    for number in every if numbers is None or count <= CHECKED else sorted({*_spread(count, MEASURED), *numbers}):
        try:
            loaded[number] = scene.load(path, settings, frame=number)
        except RecipeError as fault:
            wrong[number] = fault.problems
    if wrong:
        raise RecipeError(_described(wrong, len(wrong) + len(loaded)))
    return section, loaded


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
    """Numbers of some of so many frames, the first and the last among them."""
    return sorted(set(np.linspace(1, count, min(most, count)).round().astype(int).tolist()))


def variant_of(variant) -> str:
    """The variant of Mitsuba that renders here, where users name one or none."""
    from renderers.mitsuba import variants

    return variant or variants.choose("rgb").names[0]


def _marking(quality, variant: str):
    """Function of a frame's scene and seed: what tells the frame from others, the hash of all that its pictures depend on."""
    common = quality or "final", variant, versions()
    of_file = cache(lambda path: hashlib.sha256(path.read_bytes()).hexdigest())
    of_asset = cache(lambda path: bakery.open(path).content_hash)

    def mark(shot, seed) -> str:
        told, *files = made_of(shot)
        shown = shot.values.model_dump(mode="json", include={"stop", "display", "denoise"}, warnings=False)
        return fingerprint(told, shown, list(map(of_file, files)), list(map(of_asset, shot.assets)), shot.share,
                           shot.choice and shot.choice.method, seed or 0, *common)

    return mark
