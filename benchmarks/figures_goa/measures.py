"""Grids, averages over sizes, distances between patterns, and colours; shared by all claims."""

import os
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from bakery import goa
from bakery.physics.mie import angular as mie
from benchmarks.sizes import sized

from . import printed

WAVELENGTH = 0.6  # um, the paper's
INDICES = {"water": 1.33, "ice": 1.31, "glass": 1.5, "bubbles": 0.75}
SHOWN = ("water", "glass", "bubbles")  # in tables; ice is in the pictures, near water
THETA = np.deg2rad(np.arange(0.25, 180, 0.5))  # grid of docs/measurements/goa.md; too coarse for the forward peak of r >= 100 um
SIGMA, NODES = 1.3, sized(201, 11)  # log-normal averages; both sides of a comparison have the same nodes
SINGLE = np.linspace(0.98, 1.02, 5)  # errors of single spheres are means over these multiples of the radius

PLAIN = dict(rainbow=False, axis=False, edge=None)
VARIANTS = {  # name: (how, options); printed: 3 orders as the paper settles for, ours: 6
    "as printed": ("printed", dict(orders=3)),
    "floors + taper": ("ours", PLAIN),
    "+ rainbow + axis": ("ours", dict(edge=None)),
    "+ edge": ("ours", dict(edge="narrow")),
    "+ wide edge": ("ours", dict(edge="wide")),
}
INK = "#1c2530"
COLOURS = {"Mie": INK, "as printed": "#c2410c", "one ray": "#d97fa8", "floors + taper": "#c99a06", "+ rainbow + axis": "#2a7fba",
           "+ edge": "#2b8a4b", "+ wide edge": "#7b4fb5"}
OF_INDEX = {"water": "#2a7fba", "ice": "#4fb0ae", "glass": "#8a5a2b", "bubbles": "#b23a6f"}


def size_parameter(radius):
    """2 pi r/lambda, radius in um."""
    return 2 * np.pi * np.asarray(radius, dtype=np.float64) / WAVELENGTH


def sphere_grid(x):
    """Angles (rad) that resolve the diffraction peak of size parameter x as well as the rest; 0 and pi left out."""
    peak = np.arange(0.05, 12.0, 0.1) / x
    rest = np.deg2rad(np.arange(0.5, 179.9, 0.25))
    ring = np.geomspace(peak[-1], rest[0], 120)[1:-1] if peak[-1] < rest[0] else np.empty(0)
    return np.unique(np.concatenate([peak, ring, rest[rest > peak[-1]]]))


def log_normal(radius, sigma=SIGMA, nodes=NODES):
    """Size parameters and numbers of spheres, evenly spaced in ln r out to three standard deviations."""
    y = np.linspace(-3.0, 3.0, nodes)
    return size_parameter(radius) * np.exp(y * np.log(sigma)), np.exp(-0.5 * y * y) / nodes


def exact(m, x, weight, theta):
    out = np.empty(theta.size)
    mie.intensity_block(complex(m), x, weight, theta, out)
    return out


def found(variant, m, x, weight, theta):
    """Intensity (A,) by one of VARIANTS."""
    how, options = VARIANTS[variant]
    if how == "ours":
        out = np.empty(theta.size)
        goa.intensity_block(m, x, weight, theta, out, 6, **options)
        return out
    s1, s2 = printed.amplitudes(m, x, theta, **options)
    return 0.5 * weight @ (abs(s1) ** 2 + abs(s2) ** 2)


def solid_angle(theta):
    """(A,) weights of the trapezoidal rule over the sphere, sr."""
    step = np.empty(theta.size)
    step[1:-1] = theta[2:] - theta[:-2]
    step[0], step[-1] = theta[1] - theta[0], theta[-1] - theta[-2]
    return np.pi * np.sin(theta) * step


def rms_log10(f, g):
    return float(np.sqrt(np.mean(np.log10(f / g) ** 2)))


def l1(f, g, theta):
    """Integral of |f - g| of the two phase functions, each normalised to 1: twice the share of light sent elsewhere."""
    solid = solid_angle(theta)
    return float(np.sum(abs(f / np.sum(f * solid) - g / np.sum(g * solid)) * solid))


def relative_square(a, b):
    """RelMSE as the paper may mean it, evenly in angle: (mean of the square of (a - b)/b, ratio of sums of squares)."""
    return float(np.mean(((a - b) / b) ** 2)), float(np.sum((a - b) ** 2) / np.sum(b**2))


def mean_amplitude(s1, s2):
    """(|S1| + |S2|)/2, the quantity of figs. 2 and 6."""
    return 0.5 * (abs(s1) + abs(s2))


def first_below(radius, error, limit):
    """Smallest radius from which the error stays below the limit, between grid points by a power law; None if it never does."""
    above = np.flatnonzero(np.asarray(error) >= limit)
    if not above.size:
        return float(radius[0])
    i = above[-1]
    if i + 1 == len(radius):
        return None
    if error[i + 1] == 0.0:
        return float(radius[i])
    share = np.log(error[i] / limit) / np.log(error[i] / error[i + 1])
    return float(radius[i] * (radius[i + 1] / radius[i]) ** share)


def together(function, tasks):
    """[function(*task)], in order, on all cores: the kernels release the lock."""
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return list(pool.map(lambda task: function(*task), tasks))


def table(head, rows):
    """Markdown."""
    first, *others = ("| " + " | ".join(str(cell) for cell in line) + " |" for line in [head, *rows])
    return "\n".join([first, "|---" * len(head) + "|", *others])


def short(value):
    """Two digits."""
    if value is None:
        return "never"
    if value == 0 or abs(value) >= 0.001:
        return f"{float(f'{value:.2g}'):g}"
    mantissa, power = f"{value:.0e}".split("e")
    return f"{mantissa}e{int(power)}"
