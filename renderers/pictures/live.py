"""Scenes whose pictures are looked at while their passes go on: `Pictures` for programs and notebooks, `render` for a page.

    for picture in Pictures("lamp.yaml"):
        print(picture)
"""

import threading
import time
from typing import NamedTuple

import numpy as np

from bakery.errors import BakeryError, UsageError
from renderers import scene, seeds
from renderers.mitsuba import variants
from renderers.pictures import denoise, passes, running
from renderers.pictures.picture import DENOISED, NOISE, PICTURE, Picture, words_of

import mitsuba as mi  # isort: skip  # after renderers.mitsuba, which finds LLVM, once

SHARE = 0.04  # of the passes' processor time that frames of a page may take
_ASKED = 5.0  # s for which a page is taken to look at the layer that it asked for last
_A_PIXEL = 2e-6  # s that the filter of the first picture is expected to take
_FRAMES = 4  # that are kept, 30 bytes a pixel each
_OFTEN = 0.1  # s between two pictures, at least: a pass may take a thousandth of that
_FIGURES = ("noise", "noise_region", "noise_mean")  # of a report


def refuse_other(scene) -> None:
    """Raises UsageError where a scene's renderer goes by no passes."""
    if not scene.rules.RESUMES:
        raise UsageError(f"{scene.path}: the renderer {scene.section} makes its picture at once, not by passes, so that there is "
                         "nothing to see before its end; use bake render without --live")


def _prepared(path, output, begins=None, *, overrides=None, variant=None, seed=None, resume=False, **options) -> passes.Rendering:
    """options : `quality`, `progress`, `overwrite` of `renderers.pictures.running.Render`."""
    seed = seeds.checked(seed)  # before anything is baked
    opened = path if isinstance(path, scene.Scene) else scene.load(path, overrides)
    refuse_other(opened)
    return passes.Rendering(running.Render(opened, output, **options), variant, seed, resume, begins)


def _picture(rendering, *, noise=None, denoised=None, report=None) -> Picture:
    estimate = rendering.estimate
    return Picture(estimate.so_far(), rendering.job.scene.values.display, rendering.method.name, denoised=denoised, report=report,
                   seconds_left=None if report else estimate.seconds_left(rendering.stop, noise))


# ---- for programs


class Pictures:
    """The pictures of a render, one after another: an iterator of `renderers.pictures.picture.Picture`.

    The passes run only while the next picture is requested.  The last picture is the one that is written, and has the `report`.
    Leaving the loop before that writes no files, and existing ones stay; `stop` ends the passes and has the picture written.  In
    a notebook `Pictures` as the last line of a cell shows one picture that is updated.

    Attributes
    ----------
    report : of the render, once its last picture is there; None before
    """

    def __init__(self, path, output=None, *, every: float = 0.5, **options):
        """
        Parameters
        ----------
        path : of the scene, or what `renderers.scene.load` made of it
        output : `X.png` or `X.exr`, both are written; beside the scene, by its name, if None
        every : s of passes between two pictures, at least; 0: a picture after each pass
        options : `overrides`, `quality`, `variant`, `seed`, `progress`, `overwrite`, `resume`, as renderers take them

        Raises
        ------
        RecipeError, UsageError, AssetError, StageError, StoreError : as `render` of the scene's renderer; UsageError also where
            that goes by no passes
        """
        self._rendering, self._every = _prepared(path, output, **options), every
        self._asked, self._over, self.report = False, False, None

    def __iter__(self) -> "Pictures":
        return self

    def __next__(self) -> Picture:
        """The next picture.

        Raises Interrupted where SIGINT or SIGTERM came while passes went on: after the picture so far was written.
        """
        if self._over:
            raise StopIteration
        estimate, noises = self._rendering.estimate, []
        before, begin = estimate.count, estimate.spent

        def enough(noise):
            noises[:] = [noise]
            return self._asked or estimate.count > before and estimate.spent - begin >= self._every

        if self._rendering.variant != mi.variant():  # between two pictures a program may have rendered something else
            mi.set_variant(self._rendering.variant)
        self._over = True  # unless all goes well
        self._rendering.run(enough)
        if estimate.stopped_by == "request" and not self._asked:
            self._over = False
            return _picture(self._rendering, noise=noises[0])
        self.report = self._rendering.finish()
        rendering, self._rendering = self._rendering, None  # which holds the scene
        cleared = rendering.denoised
        return _picture(rendering, denoised=None if cleared is None else cleared.rgb, report=self.report)

    def stop(self) -> None:
        """Ends the passes; the next picture is the last one, which is written."""
        self._asked = True

    def _ipython_display_(self) -> None:
        from IPython.display import display

        handle = None
        for picture in self:
            if handle is None:
                handle = display(picture, display_id=True)
            else:
                handle.update(picture)


# ---- for a page


class Frame(NamedTuple):
    """A layer as a page draws it.

    number : 1, 2, ... of the frames of a render
    passes : in the picture that it is of
    png : bytes
    values : bytes of what a pixel is said to have, (H, W, 3) or, with standard errors behind the colours, (H, W, 6): floats of 32
        bits, little-endian
    white : relative error that is brightest in the map of noise, 0 of other layers
    """

    number: int
    passes: int
    png: bytes
    values: bytes
    white: float


class Allowance:
    """Processor time that something may take beside the passes: a share of what they took.

    share : of the time
    clock : seconds that the passes took: of all processors, or, where these wait for a graphics card, of the clock
    """

    def __init__(self, share: float, clock=time.process_time):
        self._share, self._clock, self._begin, self.spent = share, clock, clock(), 0.0

    def allows(self, seconds: float) -> bool:
        return self.spent + seconds <= self._share * (self._clock() - self._begin)


class Watch:
    """A render as pages see it: what goes on, frames of the newest picture, and the wish to stop it.  For several threads.

    Frames are drawn where a page asks for them, in its thread, and no more of them than `SHARE` of the time allows: an older one
    stands until then.  The filter of the noise runs between passes, and as seldom.
    """

    def __init__(self):
        self._news, self._drawing = threading.Condition(), threading.Lock()
        self._state = {"version": 0, "phase": "preparing", "part": "scene", "text": "", "layers": []}
        self._picture: Picture | None = None
        self._frames: dict[str, tuple[Picture, Frame]] = {}
        self._seconds: dict[str, float] = {}  # that frames took, and the filter
        self._looked_at: dict[str, float] = {}  # when pages asked for a layer last
        self._asked, self._seen, self._count = False, -np.inf, 0
        self._rendering = self._denoised = None

    # -- what the render calls

    def prepare(self, part: str) -> None:
        """A part of what comes before the passes begins."""
        self._tell(part=part)

    def begin(self, rendering) -> None:
        """The passes of a `renderers.pictures.passes.Rendering` begin."""
        stop, (height, width) = rendering.stop, rendering.estimate.identity["size"]
        clock = variants.clock(rendering.variant)
        self._rendering, self._drawn, self._filtered = rendering, Allowance(SHARE, clock), Allowance(SHARE, clock)
        self._seconds["filter"] = _A_PIXEL * height * width
        self._filters = denoise.chosen(rendering.job.scene.values, rendering.job.quality, "")[0]
        self._tell(phase="passes", size=[width, height], method=rendering.method.name, reasons=list(rendering.reasons),
                   wanted=stop.noise, pixels=stop.pixels, time=stop.time, most_samples=stop.samples, samples=0, passes=0,
                   seconds=0.0, seconds_left=stop.time, noise=None)

    def observe(self, noise) -> bool:
        """Between two passes: takes the picture so far; whether somebody wants them to end."""
        now = time.monotonic()
        if now - self._seen >= _OFTEN:
            self._seen = now
            if self._filters and now - self._looked_at.get(DENOISED, -np.inf) < _ASKED and \
                    self._filtered.allows(self._seconds["filter"]):
                self._filter()
            self._take(_picture(self._rendering, noise=noise, denoised=self._denoised), noise=_finite(noise))
        return self._asked

    def _filter(self):
        begin = time.process_time()
        cleared, _ = self._rendering.cleared()
        self._seconds["filter"] = time.process_time() - begin
        self._filtered.spent += self._seconds["filter"]
        self._denoised, self._filters = None if cleared is None else cleared.rgb, cleared is not None

    def _take(self, picture, **news):
        names = picture.names()
        names[1:1] = [DENOISED] * (self._filters and DENOISED not in names)
        self._picture = picture
        self._tell(samples=picture.samples, passes=picture.passes.count, seconds=picture.seconds,
                   seconds_left=_finite(picture.seconds_left),
                   layers=[{"name": name, "words": words_of(name)} for name in names], **news)

    def write(self) -> None:
        """The passes are over."""
        self._tell(phase="writing")

    def over(self, report) -> None:
        """The picture is written."""
        self._filters, cleared = False, self._rendering.denoised
        self._take(_picture(self._rendering, denoised=None if cleared is None else cleared.rgb, report=report),
                   noise=_finite(max(filter(None, (report[name] for name in _FIGURES)), default=None)))
        self._tell(phase="over", text="The render is over.", figures={name: _finite(report[name]) for name in _FIGURES},
                   report={name: report[name] for name in ("files", "missed", "reasons", "stopped_by")})

    def failed(self, text: str) -> None:
        """It was interrupted, or could not be rendered."""
        self._tell(phase="failed", text=text)

    def _tell(self, **news):
        with self._news:
            self._state = self._state | news | {"version": self._state["version"] + 1}
            self._news.notify_all()

    # -- what pages call

    def state(self, seen: int = -1, seconds: float = 0.0) -> dict:
        """What goes on, once it is another version than the one that was seen, or after so many seconds."""
        with self._news:
            self._news.wait_for(lambda: self._state["version"] != seen, seconds)
            state = self._state
        return state | {"stopping": self._asked and state["phase"] in ("preparing", "passes")}

    @property
    def ended(self) -> bool:
        return self._state["phase"] in ("over", "failed")

    def frame(self, name: str) -> Frame | None:
        """A layer of the newest picture, or its last frame while another would take too much time; None where there is none."""
        self._looked_at[name] = time.monotonic()
        with self._drawing:
            picture, (drawn, frame) = self._picture, self._frames.get(name, (None, None))
            if picture is None or name not in picture.names():
                return None
            if frame is not None and (drawn is picture or not (
                    self.ended or self._drawn.allows(self._seconds.get(name, 0.0)))):
                return frame
            begin, self._count = time.thread_time(), self._count + 1
            frame = _frame(picture, name, self._count)
            figures = {key: _finite(value) for key, value in picture.figures.items()}
            self._frames.pop(name, None)
            self._frames[name] = picture, frame
            for oldest in list(self._frames)[:-_FRAMES]:
                del self._frames[oldest]
            self._seconds[name] = time.thread_time() - begin
            self._drawn.spent += self._seconds[name]
        if not self.ended:
            self._tell(figures=figures)
        return frame

    def stop(self) -> None:
        """The passes are to end, and the picture is to be written."""
        self._asked = True
        self._tell()


def _frame(picture, name, number) -> Frame:
    values = picture.linear(name)
    if name == PICTURE and picture.error is not None:
        values = np.concatenate([values, picture.error[..., :3]], axis=-1)
    return Frame(number, picture.passes.count, picture.png(name, level=0), values.astype("<f4").tobytes(),
                 picture.largest_error if name == NOISE else 0.0)


def _finite(value):
    """A number, None where it is none: JSON has no others."""
    return None if value is None or not np.isfinite(value) else float(value)


def render(path, output, watch: Watch, **options) -> dict:
    """Renders a scene that a page watches; options, report and errors are those of `Pictures`."""
    try:
        rendering = _prepared(path, output, watch.prepare, **options)
        watch.begin(rendering)
        rendering.run(watch.observe)
        watch.write()
        report = rendering.finish()
        watch.over(report)
        return report
    except BaseException as fault:
        watch.failed(str(fault) if isinstance(fault, BakeryError) else f"the render has ended: {type(fault).__name__}")
        raise
