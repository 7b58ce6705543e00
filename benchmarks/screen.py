"""Fog in screen space: the filter against gathering every pair of pixels, in one run: python benchmarks/screen.py [HEIGHT WIDTH]

Times are of one core (process time).  Gathering is timed, and the error counted, on a random share of the pixels and scaled to
all.  Errors are root mean square over the image's mean, the largest of the channels; "scattered": over the mean of the scattered
light alone.

Before that powers and shapes of kernels against photons that stop at the plane (nothing is behind it to send them back): sum of
differences of shares over rings to 10 depths and what is beyond.
"""

import math
import sys
import tempfile
import time
import tracemalloc
from dataclasses import replace
from pathlib import Path

import numpy as np

import bakery
from benchmarks.sizes import sized
from renderers.fog import filter as screen
from renderers.fog import kernels
from tests.oracles import beam as oracle
from tests.oracles.fog import direct

RECIPE = """\
bakery: 1
name: fog
wavelengths: [0.45, 0.55, 0.65]
tolerance: 5%
medium: {albedo: [1, 0.95, 0.9], mean_free_path: [10, 8, 12] m, phase: {type: gaussian, spread: 30 deg}}
beam: {depth: 32, photons: 2000, tolerance: 50%}  # photons measure an error and change no kernel: a few do
"""
MEDIA = {"Gaussian, 30 degrees": "{type: gaussian, spread: 30 deg}", "Henyey-Greenstein, g = 0.85": "{type: hg, g: 0.85}"}
DEPTHS = (0.1, 0.5, 1, 3, 10)
PIXELS = sized(96, 4)  # that gathering is timed with
ROUNDS = sized(2, 1)


def scene(height, width, seed=1):
    """A wall at 60 m, a floor, boxes with sharp edges, lamps, uneven fog: image, distance, angle, column, lever."""
    random = np.random.default_rng(seed)
    y, x = (np.mgrid[0:height, 0:width] + 0.5) / np.array([height, width])[:, None, None]
    z = np.minimum(60.0, 2 / np.maximum(y - 0.55, 1e-3))
    for cx, cy, r, d in random.uniform((0, 0.2, 0.02, 4), (1, 0.8, 0.1, 40), (14, 4)):
        z = np.where((abs(x - cx) < r) & (abs(y - cy) < r), np.minimum(z, d), z)
    image = np.stack([0.2 + 0.3 * np.sin(20 * x + c) ** 2 + 0.3 * (np.sin(37 * y + 3 * c) > 0.3) for c in range(3)], -1)
    image *= (0.4 + 0.6 * np.sin(3 * z) ** 2)[..., None]
    image[random.random((height, width)) < 30 / (height * width)] = 30.0
    column = z * (1 + 0.6 * np.sin(6 * x + 2 * y) * np.cos(9 * y) + 0.3 * np.sin(31 * x * y))
    return image, z, np.full(z.shape, 0.8 / width), column, z * (1 + 0.4 * np.sin(8 * x - 5 * y))


def errors(found, expected, direct):
    """Over the image's mean, over the scattered light's, and the largest difference over the image's largest value."""
    off = np.sqrt(np.square(found - expected).mean(0))
    return (off / expected.mean(0)).max(), (off / (expected - direct).mean(0)).max(), abs(found - expected).max() / expected.max()


def half_way(fog, angle, column, lever, z):
    """Radius in pixels that holds half of the scattered light at the middle pixel, green."""
    i = int(fog.place(np.median(column) * fog.sigma_t[1], fog.depth))
    ratio = np.interp(0.5, fog.within[1, i], fog.ratio)
    return ratio * np.median(lever) / (np.median(z) * np.median(angle))


def timed(function, *arguments, **options):
    start = time.process_time()
    found = function(*arguments, **options)
    return time.process_time() - start, found


def frame(fog, height, width):
    """One frame: both programs in turn."""
    arguments = scene(height, width)
    some = np.random.default_rng(2).choice(height * width, PIXELS, replace=False)
    image, z, angle, column, lever = arguments
    through = (np.exp(-column[..., None] * fog.sigma_t) * image).reshape(-1, 3)[some]
    times, quicker = [], {name: [] for name in ("draft", "preview")}
    # of one wavelength for all channels
    grey = replace(fog, **{name: getattr(fog, name)[1:2] for name in ("sigma_t", "sigma_s", "g", "peak", "shape", "width")})
    for _ in range(ROUNDS):
        alone, _ = timed(screen.fogged, *arguments, grey)
        fast, found = timed(screen.fogged, *arguments, fog)
        slow, expected = timed(direct, *arguments, fog, pixels=some)
        times.append((fast, slow * height * width / PIXELS, alone))
        for name, rounds in quicker.items():
            rounds.append(timed(screen.fogged, *arguments, fog, points=name))
    fast, slow, alone = np.min(times, axis=0)
    error = errors(found.reshape(-1, 3)[some], expected, through)
    print(f"{width} x {height}: filter {fast:.2f} s, every pair {slow:.0f} s (from {PIXELS} pixels): ratio {fast / slow:.5f}")
    print(f"  one wavelength: {alone:.2f} s, {alone / fast:.2f} times that of three")
    print(f"  error {error[0]:.2%} of the mean, {error[1]:.2%} of the scattered light's mean, largest {error[2]:.2%} of the peak")
    for name, rounds in quicker.items():
        off = errors(rounds[0][1].reshape(-1, 3)[some], expected, through)
        print(f"  {name}: {min(seconds for seconds, _ in rounds):.2f} s, error {off[0]:.2%} of the mean, {off[1]:.2%} of the "
              "scattered light's mean")
    # gathering may stop where it is 1 % wrong, too
    for reach in (25, 50, 100, 200, 400):
        near, cut = timed(direct, *arguments, fog, pixels=some, reach=reach)
        off = errors(cut, expected, through)[0]
        if off < 0.01 or reach >= 400:
            print(f"  gathering within {reach} pixels: error {off:.2%}, {near * height * width / PIXELS:.0f} s: "
                  f"ratio {fast / (near * height * width / PIXELS):.4f}")
            break
    tracemalloc.start()
    screen.fogged(*arguments, fog)
    print(f"  memory {tracemalloc.get_traced_memory()[1] / 1e6:.0f} MB besides the picture's inputs")
    tracemalloc.stop()


def radii(fog, height, width):
    """Cost and error against the kernel's size."""
    image, z, angle, column, lever = scene(height, width)
    some = np.random.default_rng(4).choice(height * width, 2 * PIXELS, replace=False)
    unit = half_way(fog, angle, column, lever, z)
    rows, wanted = [], (2, 5, 20, 50, 200)
    for _ in range(ROUNDS):
        rows.append([timed(screen.fogged, image, z, angle * (unit / r), column, lever, fog) for r in wanted])
    for k, r in enumerate(wanted):
        expected = direct(image, z, angle * (unit / r), column, lever, fog, pixels=some)
        through = (np.exp(-column[..., None] * fog.sigma_t) * image).reshape(-1, 3)[some]
        error = errors(rows[0][k][1].reshape(-1, 3)[some], expected, through)
        seconds = np.min([row[k][0] for row in rows])
        if k == 0:
            base = seconds
        print(f"  half of the light within {r:3d} pixels: {seconds:.2f} s, {seconds / base:.2f} times the first; "
              f"error {error[0]:.2%}, scattered {error[1]:.2%}")


def constants(fog):
    """A constant image, no absorption (blue): largest change, over sizes, kernels, cut-offs and depth images."""
    worst = 0.0
    for seed, (height, width) in enumerate(sized(((1, 1), (33, 47), (120, 160), (7, 300)), ((1, 1), (7, 30)))):
        _, z, angle, column, lever = scene(height, width, seed)
        for pixel in (1e-8, 1e-5, 1e-3, 0.1, 10):
            for cut in (None, 0.5, 3):
                found = screen.fogged(np.ones((height, width, 3)), z, pixel, column, lever, fog, cut_off=cut)
                worst = max(worst, abs(found[..., 2] - 1).max())
    print(f"constant image: largest change {worst:.1e}")


def edges(fog):
    """Colour bleed: half of the picture at 5 m, half at 50 m, one black and one white; closed forms from the near kernel."""
    u, c, n = 0.2, 2, 160
    x = np.arange(n) + 0.5 - n / 2
    i = int(fog.place(0.8, fog.depth))
    column, far_column, tau = fog.depth[i] / fog.sigma_t[c], 40.0, fog.depth[i]
    weight = np.diff(fog.within[c, i], prepend=0)
    H = np.array([np.sum(weight * np.arccos(np.clip(d * u / fog.ratio, -1, 1))) / math.pi for d in abs(x)])
    left = np.broadcast_to(x < 0, (120, n))
    z, column = np.where(left, 5.0, 50.0), np.where(left, column, far_column)
    share, far_tau = -math.expm1(-tau), far_column * fog.sigma_t[c]
    here = abs(x) < 25
    for name, lit in (("near black, wall white", ~left), ("near white, wall black", left)):
        exact = np.where(x < 0, share * H, math.exp(-far_tau) - math.expm1(-far_tau) - share * H)
        exact = exact if lit is not left else 1 - exact
        image = np.where(lit, 1.0, 0.0)[..., None] * np.ones(3)
        found = screen.fogged(image, z, u, column, z, fog)[60, :, c]
        print(f"  {name}: largest difference from the closed form {abs(found - exact)[here].max():.4f} of white; beside the edge "
              f"{found[n // 2 - 1]:.4f} | {found[n // 2]:.4f}, exact {exact[n // 2 - 1]:.4f} | {exact[n // 2]:.4f}")


def arrivals(folder, count=sized(400_000, 6400)):
    """Power and shape of the kernels against photons; the photons' noise is 0.3 % and 0.02."""
    theta = np.union1d(np.geomspace(1e-4, math.pi, 3000), np.linspace(0, math.pi, 2001))
    for name, phase in MEDIA.items():
        path = folder / "arrivals.yaml"
        recipe = RECIPE.replace("[1, 0.95, 0.9]", "[1, 0.9, 0.5]").replace("{type: gaussian, spread: 30 deg}", phase)
        path.write_text(recipe.replace("[10, 8, 12] m", "1 m"))
        asset = bakery.open(bakery.bake(path, output=path.with_suffix(".h5")))
        fog, tables = kernels.fog_of(asset), asset.medium.phase(theta)
        for k, albedo in enumerate(asset.medium.albedo):
            c, power, shape = len(tables) - 1 - k, [], []
            for tau in DEPTHS:
                edges = tau * np.r_[0, np.geomspace(0.01, 10, 31), 1e9]
                found = oracle.count(float(albedo), theta, tables[k], [tau], edges, count, layers=((0.0, tau), (1.0, 0.0)))
                light = found.flux[0] * math.pi * np.diff(edges**2)
                i = fog.place(tau, fog.depth)
                within = (1 - i % 1) * fog.within[c, int(i)] + i % 1 * fog.within[c, int(i) + 1]
                inside = np.r_[np.interp(edges[:-1] / tau, np.r_[0, fog.ratio], np.r_[0, within]), 1]
                power.append(fog.powers(np.array(tau), "lost")[0][c] / light.sum() - 1)
                shape.append(abs(np.diff(inside) - light / light.sum()).sum())
            print(f"  {name}, albedo {albedo:g}: power " + ", ".join(f"{100 * p:+.1f} %" for p in power) + "; shares "
                  + ", ".join(f"{d:.2f}" for d in shape))


def main():
    height, width = (int(n) for n in sys.argv[1:3]) if len(sys.argv) > 2 else sized((480, 640), (12, 16))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "fog.yaml")
        path.write_text(RECIPE)
        asset = bakery.open(bakery.bake(path, output=path.with_suffix(".h5")))
        print(f"light that arrives, optical depths {DEPTHS}:")
        arrivals(Path(folder))
    start = time.process_time()
    fog = kernels.fog_of(asset)
    print(f"kernels from an asset: {time.process_time() - start:.2f} s, {fog.shape.shape}, {fog.shape.nbytes / 1e6:.1f} MB")
    small = scene(24, 32)
    direct(*small, fog, pixels=np.arange(4)), screen.fogged(*small, fog)  # compiles
    frame(fog, height, width)
    print("kernel's size:")
    radii(fog, height, width)
    constants(fog)
    print("depth edges:")
    edges(fog)
    print(f"other kernels, {sized(160, 16)} x {sized(120, 12)}:")
    height, width = sized((120, 160), (12, 16))
    arguments = scene(height, width)
    for name in ("fluence", "small_angle", "erf", "path_integral", "elek", "single"):
        other = kernels.fog_of(asset, kernel=name)
        some = np.random.default_rng(6).choice(height * width, sized(200, 4), replace=False)
        found, expected = screen.fogged(*arguments, other), direct(*arguments, other, pixels=some)
        through = (np.exp(-arguments[3][..., None] * fog.sigma_t) * arguments[0]).reshape(-1, 3)[some]
        print(f"  {name}: error {errors(found.reshape(-1, 3)[some], expected, through)[0]:.2%}")


if __name__ == "__main__":
    main()
