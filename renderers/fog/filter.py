"""Light that fog scatters between a picture's surfaces and the camera: a blur whose kernel differs from pixel to pixel.

A viewing ray spreads like a narrow beam that starts at the camera (`kernels`).  A pixel p shows

    e^-tau col + near + far:
    near: sum over nearer pixels p' of K_p'(d) col',  K = P k,  P the power (`kernels.Fog.powers`),  k its share in a pixel,
    far:  what the beam has left after those, P (1 - q/s), times the mean of col over the other pixels, weighted by k_p(d);
          s = 1 - e^-tau_s is scattered, nearer pixels take q = sum of s' k_p'(d) of it,

so a nearer thing is blurred by its own, shorter path (Shinya et al. 2016, section 5), each pair of pixels counts once, and a
constant picture without absorption stays constant for any distances.

The sums go over all pixels.  `fogged` takes near pixels one by one and others in blocks of 2, 4, 8 ... pixels,
whose side is a fifth to four fifths of their distance: the kernel is split into smooth bands, K = sum K w_l, and band l is summed
over blocks of 2^l pixels, at the centre of their light.  A block keeps its sums in classes of distance from the camera.

What a band brings is as smooth as its blocks are large: it is summed at points as close as they are, or twice or four times as
close (POINTS), for each class of distance, and is linear between these.  So most of the time goes to the smallest blocks; it does
not know the kernel's size.
"""

import math

import numpy as np

from bakery.errors import UsageError
from renderers.fog import _blocks, _filter, kernels
from renderers.fog._lanes import LANES
from renderers.fog._prepared import INNER, Prepared
from renderers.threads import run

# A band is summed at points as close as the blocks of so many levels below
POINTS = {"draft": 0, "preview": 1, "final": 2, "every pixel": math.inf}
# Root mean square difference from the sum over every pair of pixels (tests/oracles/fog.py), over the picture's mean, 640 x 480
# with lamps and edges (benchmarks/screen.py)
ERRORS = {"draft": 0.0054, "preview": 0.0048, "final": 0.0046, "every pixel": 0.0046}
_ROWS, _TARGETS = 16, 4096  # rows, targets of a task


def fogged(image, distance, angle, column, lever, medium, *, points="final", progress=None, **options):
    """A picture seen through fog, without light from elsewhere.

    Parameters
    ----------
    image : (H, W, C) radiance of the surfaces as seen without fog; up to LANES channels
    distance : (H, W) m, along the viewing ray
    angle : (H, W) rad, side of a pixel
    column : (H, W) m, integral of the relative density along the ray
    lever : (H, W) m, sqrt(3 S_2/S_0), S_n the integral of density times (distance to the surface)^n; at constant density it is
        the distance
    medium : kernels.Fog of C channels, or of one for all
    points : name of POINTS, how close the points are
    progress : function of the share that is done, or None
    options : outside, "edge": the surroundings look like what the picture shows of them, "black": they are dark; energy, "lost":
        scattered light has the power that transport gives it, "kept": what went back past the camera is added; cut_off: lengths
        (kernels.Fog.width) beyond which a kernel is cut and renormalised, None: none.  If not given edge, kept and None

    Returns
    -------
    (H, W, C) radiance; where column is 0 it is the image's, to the last bit

    Raises
    ------
    UsageError : shapes do not fit, something is not finite or negative; the text names it

    Notes
    -----
    Root mean square difference from the sum over every pair of pixels: ERRORS for a scene with lamps and edges
    (benchmarks/screen.py); around a single bright pixel in the dark 12, 4, 1.8 and 1.6 % of the mean.  Time: 2, 3 and 4 us a
    pixel.  Memory: some 700 bytes a pixel.
    """
    if points not in POINTS:
        raise UsageError(f"filter: points {points!r}; {', '.join(POINTS)} would do")
    image, kinds = np.asarray(image, float), len(medium.sigma_t)
    if image.ndim != 3 or image.size == 0 or image.shape[2] > LANES or kinds not in (1, image.shape[2]):
        raise UsageError(f"image: shape {image.shape}; (height, width, {kinds if kinds > 1 else f'1 to {LANES}'}) would do")
    p = Prepared(image, (distance, angle, column, lever), medium, **options)
    if not p.power.any():  # nothing is scattered
        return p.finished(np.zeros((*p.z.shape, _filter.SUMS, LANES)))
    pyramid, sums, targets = _pyramid(p), None, None
    for number in range(len(pyramid), 0, -1):
        level = _level(p, pyramid[number - 1], number)
        targets, sums = _refined(p, pyramid, max(number - POINTS[points], 0), targets, sums)
        _in_parts(_filter.level_targets, len(targets.y), _TARGETS, targets, p.kernels, level, p.band, sums)
        if progress:
            progress(1 - number / (len(pyramid) + 1))
    targets, sums = _refined(p, pyramid, 0, targets, sums)
    _in_parts(_filter.nearest_rows, len(p.z), _ROWS, p.pixels, p.kernels, p.nearest(), sums)
    return p.finished(sums.reshape(*p.z.shape, *sums.shape[1:]))


def _in_parts(function, count, size, *arguments):
    """function(low, high, *arguments) for ranges up to a count."""
    run(lambda low, high: function(low, high, *arguments), count, block=size)


def _pyramid(p):
    """Blocks of 2, 4, 8 ... pixels."""
    pyramid, side = [], 1
    while INNER * side < math.hypot(*p.z.shape):
        side *= 2
        mask = _blocks.merged_mask(pyramid[-1].mask if pyramid else p.mask)
        start = _blocks.starts(mask)
        blocks = _blocks.Blocks(mask, start, np.empty((start[-1], _blocks.ENTRY)))
        if pyramid:
            _in_parts(_blocks.merge_rows, len(mask), _ROWS, pyramid[-1], blocks)
        else:
            _in_parts(_blocks.first_rows, len(mask), _ROWS, p.pixels, p.mask, blocks)
        pyramid.append(blocks)
    return pyramid


def _level(p, blocks, number):
    """Blocks of 2^number pixels as what they send."""
    side = 2.0**number
    shift = (math.log(INNER / 2) + math.log(side)) / kernels.STEP
    profiles = np.empty((len(blocks.entries) + 1, _filter.NODES, LANES), np.float32)
    _in_parts(_filter.profiles, len(blocks.entries), _TARGETS, p.kernels, blocks.entries, shift, side, profiles)
    return _filter.Level(side, shift, blocks, profiles)


def _refined(p, pyramid, number, targets, sums):
    """Points 2^number pixels apart (0: the pixels), and sums there from those of points that are as close or half as close."""
    if targets is not None and len(targets.mask) == (len(pyramid[number - 1].mask) + 1 if number else len(p.mask)):
        return targets, sums
    if number:
        blocks = pyramid[number - 1]
        mask = _blocks.corner_mask(blocks.mask)
        start = _blocks.starts(mask)
        finer = _blocks.Targets(mask, start, *(np.empty(start[-1]) for _ in range(5)))
        _in_parts(_blocks.corner_rows, len(mask), _ROWS, blocks, 2.0**number, finer)
    else:
        finer = p.targets()
    total = np.zeros((len(finer.y), _filter.SUMS, LANES))
    if targets is not None:
        _in_parts(_filter.between_points, len(finer.mask), _ROWS, 0.0 if number else 0.5, finer, targets, sums, total)
    return finer, total
