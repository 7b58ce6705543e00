"""Progressive rendering: passes of fixed size until the noise, the number of passes or the time is reached."""

from __future__ import annotations

import gc
import signal
import threading
import time
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from renderers import images


@dataclass(frozen=True)
class Picture:
    """What was rendered.

    Attributes
    ----------
    rgb : (H, W, 3) linear sRGB
    halves : pair of (H, W, 3), means of the even and of the odd passes
    variance : (H, W, 3), of `rgb`, from the scatter of the passes
    samples : per pixel and wavelength
    noise : root mean square standard error of the luminance over its mean
    stopped_by : `noise`, `samples` or `time`
    seconds : wall time
    """

    rgb: np.ndarray
    halves: tuple[np.ndarray, np.ndarray]
    variance: np.ndarray
    samples: int
    noise: float
    stopped_by: str
    seconds: float


# Paths in one call of Mitsuba: an interruption waits for the end of the call, here a second or two.
PATHS = 900_000


def render(scenes, matrix, *, samples, per_pass, tolerance=0.0, time_limit=None, seed=0, measure=None, progress=None) -> Picture:
    """Renders one scene a wavelength and combines them to colour.

    Parameters
    ----------
    scenes : list of L scenes
    matrix : (3, L), see `colour.srgb_matrix`; None where the scene is in colour already (L = 1)
    samples, per_pass : per pixel and wavelength; at least two passes are rendered, of fewer samples where the film is large
    tolerance : noise at which to stop
    time_limit : seconds after which no further pass is begun, or None.  A picture that stops by time depends on the machine
    measure : function of (picture, error of it by chance) that gives the noise of what is made of the picture, by which it stops;
        asked after 2, 4, 8, ... passes, in between it goes with the picture's own
    progress : function of (fraction 0 to 1, noise so far or None)

    Notes
    -----
    All wavelengths share the random numbers of a pass, so what is grey in the scene stays grey, without colour noise.
    """
    import mitsuba as mi

    begin = time.monotonic()
    per_pass = max(1, min(per_pass, PATHS // int(np.prod(scenes[0].sensors()[0].film().size()))))
    passes = max(2, -(-samples // per_pass))
    halves, square, noise, stopped_by, made = [0.0, 0.0], 0.0, None, "samples", 1.0
    for index in range(passes):
        layers = []
        for position, scene in enumerate(scenes):
            with _undisturbed(mi):
                image = np.array(mi.render(scene, spp=per_pass, seed=seed * 65536 + index), dtype=float)
            image[~np.isfinite(image)] = 0.0  # a path whose weight overflowed counts as dark, else it blots out its pixel
            layers.append(_colour(image) if matrix is None else image[..., 0])
            if progress is not None:
                progress((index + (position + 1) / len(scenes)) / passes, noise and made * noise)
        rgb = layers[0] if matrix is None else np.stack(layers, axis=-1) @ matrix.T
        halves[index % 2] = halves[index % 2] + rgb
        square = square + rgb**2
        count = index + 1
        if count < 2:
            continue
        mean = (halves[0] + halves[1]) / count
        variance = np.maximum(square / count - mean**2, 0.0) / (count - 1)
        noise = images.relative_noise(mean, variance)
        if measure is not None and count & (count - 1) == 0:
            made = measure(mean, (halves[0] - halves[1]) / count) / max(noise, 1e-30)
        elapsed = time.monotonic() - begin
        if made * noise <= tolerance:
            stopped_by = "noise"
        elif time_limit is not None and elapsed * (count + 1) / count > time_limit and count < passes:
            stopped_by = "time"
        else:
            continue
        break
    if progress is not None:
        progress(1.0, noise)
    halves = halves[0] / ((count + 1) // 2), halves[1] / (count // 2)
    return Picture(mean, halves, variance, count * per_pass, noise, stopped_by, time.monotonic() - begin)


@contextmanager
def _undisturbed(mi):
    """Around one call of Mitsuba, which turns an interruption into an error of its own and announces it on standard output.

    SIGINT and SIGTERM are kept until the call ends and handed on then; scalar variants still stop at once.  Python's collector of
    cycles waits too: freeing Dr.Jit objects of an earlier scene while Mitsuba traces a new one has crashed (seen once in some
    hundred renders).
    """
    collecting = gc.isenabled()
    gc.disable()
    level, kept, usual = mi.log_level(), [], {}
    if threading.current_thread() is threading.main_thread():
        usual = {number: signal.signal(number, lambda *arrived: kept.append(arrived))
                 for number in (signal.SIGINT, signal.SIGTERM) if callable(signal.getsignal(number))}
    mi.set_log_level(mi.LogLevel.Error)
    try:
        yield
    finally:
        if collecting:
            gc.enable()
        mi.set_log_level(level)
        for number, handler in usual.items():
            signal.signal(number, handler)
        for number, frame in kept:
            usual[number](number, frame)


def _colour(image):
    """The first three channels, or grey where the film has one or two."""
    return image[..., :3] if image.shape[2] >= 3 else np.repeat(image[..., :1], 3, axis=2)
