"""Pictures of Mitsuba's own integrators by passes of fixed size, until the noise, the samples or the time is reached."""

import signal
from contextlib import contextmanager

import mitsuba as mi
import numpy as np

from bakery.kernels import stream_key
from renderers import seeds
from renderers.mitsuba.recording import undisturbed
from renderers.pictures.engine import TRUSTED, Part, Passes, Stop

# Paths of one pass: an interruption waits for its end, some seconds.
PATHS = 1_800_000


class Picture(Passes):
    """Passes of a single part, whose even ones are a layer of their own; samples are those of a pixel and wavelength.

    measure : of `render`
    """

    measure = None
    _ratio = 1.0  # noise of what is made of the picture, over the picture's own

    @property
    def halves(self):
        """Pair of (H, W, 3), means of the even and of the odd passes; from the second pass on."""
        mean, = self.means.values()
        even = mean.layers["even"] * (mean.count / ((mean.count + 1) // 2))  # of all passes it is: the odd ones are black there
        return even, (mean.layers[""] * mean.count - even * ((mean.count + 1) // 2)) / (mean.count // 2)

    def _noise_to_reach(self, stop):
        noise = super()._noise_to_reach(stop)
        if self.measure is None or stop.noise is None or self.count < TRUSTED:
            return noise
        # What a filter leaves falls more slowly than noise itself, as it takes less from a picture that has less
        if self.count & (self.count - 1) == 0 or self._ratio * self.noise <= stop.noise:
            self._ratio = self.measure(self) / max(self.noise, 1e-30)
        return self._ratio * self.noise


def render(scenes, matrix, *, samples, per_pass, tolerance=0.0, time_limit=None, seed=0, measure=None, progress=None) -> Picture:
    """Renders one scene a wavelength and combines them to colour.

    scenes : list of L scenes
    matrix : (3, L), see `colour.srgb_matrix`; None where the scene is in colour already (L = 1)
    samples, per_pass : per pixel and wavelength; at least two passes are rendered, of fewer samples where the film is large
    tolerance : noise at which to stop; 0: none
    time_limit : seconds after which no further pass is begun, or None.  A picture that stops by time depends on the machine
    measure : function of the `Picture` so far that gives the noise of what is made of it, by which it stops; asked after 4, 8,
        16, ... passes, in between it goes with the picture's own, and is asked again before it stops.  None: by its own
    progress : function of (fraction 0 to 1, noise so far or None)

    All wavelengths share the random numbers of a pass, so what is grey in the scene stays grey, without colour noise.
    """
    seed = seeds.checked(seed)
    pixels = int(np.prod(scenes[0].sensors()[0].film().size()))
    per_pass = max(1, min(per_pass, PATHS // (pixels * len(scenes))))

    def one_pass(index):
        seed_of_pass = int(stream_key(seed, "render.mitsuba", index)) >> 32  # Mitsuba takes 32 bits
        with _undisturbed():
            images = [np.array(mi.render(scene, spp=per_pass, seed=seed_of_pass), dtype=float) for scene in scenes]
        rgb = _colour(images[0]) if matrix is None else np.stack([image[..., 0] for image in images], axis=-1) @ matrix.T
        return {"": rgb} | ({} if index % 2 else {"even": rgb})

    picture = Picture([Part("mitsuba", one_pass, per_pass)])
    picture.measure = measure
    picture.run(Stop(noise=tolerance or None, time=time_limit, samples=samples), progress)
    if picture.signal:
        signal.raise_signal(picture.signal)  # to whoever handles it otherwise: there is no picture of some of the passes
    return picture


@contextmanager
def _undisturbed():
    """Around calls of Mitsuba, which would announce an interruption on standard output.

    Python's collector of cycles waits: freeing Dr.Jit objects of an earlier scene while Mitsuba traces a new one has crashed
    (seen once in some hundred renders).
    """
    level = mi.log_level()
    mi.set_log_level(mi.LogLevel.Error)
    try:
        with undisturbed():
            yield
    finally:
        mi.set_log_level(level)


def _colour(image):
    """The first three channels, or grey where the film has one or two."""
    return image[..., :3] if image.shape[2] >= 3 else np.repeat(image[..., :1], 3, axis=2)
