"""A square light behind a metre of fog: the filter with each kernel against path tracing.

    python benchmarks/emitter.py ASSET [--samples N] [--reference FILE] [--pictures FILE]

ASSET is the baked recipes/emitter.yaml, the scene that of assets/scenes/square_emitter.yaml, in grey, 64 x 64 pixels.  Shinya et
al. 2016, section 4.2, is the model.  The path tracer is Mitsuba's `volpath` with the phase function of the asset.  Its fog
lies between the plane of the camera and that of the light, 12 m wide, without walls; what leaves is gone, and the wall with the
light is black: what the filter assumes, but that the filter takes each pixel's plane across the viewing ray.

Error: root mean square difference over the pixels, less the path tracer's noise, over the root mean square of the reference; of
the whole picture / of the scattered light alone (the straight light e^-tau is exact in all) / of that in the middle ninth of the
picture.  The noise is that of the mean of two halves, folded over the eight symmetries of the square.  `--reference FILE` (.npz)
keeps the halves: read if it exists.

Also: the light of the whole picture over the reference's, and scattered light over it along the middle row (four parts of its
left half), which tells how the filter errs where rays meet the wall at up to 30 degrees.
"""

import argparse
import math
import time
from pathlib import Path

import numpy as np

from benchmarks.sizes import sized

SIZE, FOV, HALF_LIGHT = sized(64, 16), math.radians(60), 0.2  # pixels, of the square picture; m, at distance 1 m
HALF_BOX = 6.0  # m, sideways
TAUS = (1, 5, 10)
SHARE = {1: 0.25, 5: 1.0, 10: 2.0}  # of the samples
# in the table: kernel and energy of the filter
NAMED = {"transport, flux": ("flux", "lost"), "the same, energy kept": ("flux", "kept"),
         "small-angle model": ("small_angle", "lost"),
         "error function (Shinya)": ("erf", "lost"), "path integral": ("path_integral", "lost"),
         "Elek et al., approximate": ("elek", "lost"), "scattered once": ("single", "lost")}


def clear():
    """The picture without fog (SIZE, SIZE), its distances in m, and the sides of its pixels in rad."""
    from renderers.camera import Camera

    camera = Camera.looking([0, 0, 0], [0, 1, 0], [0, 0, 1], FOV, SIZE, SIZE)
    edge = math.tan(FOV / 2) * np.linspace(-1, 1, SIZE + 1)
    covered = np.diff(np.clip(edge, -HALF_LIGHT, HALF_LIGHT)) / np.diff(edge)
    return np.outer(covered, covered), np.linalg.norm(camera.points(SIZE, SIZE), axis=-1), camera.angle(SIZE, SIZE)


def traced(asset, tau, samples, seed, per_pass=sized(256, 4)):
    """Path tracing: the mean of `samples` a pixel, folded over the symmetries."""
    import mitsuba as mi

    T = mi.ScalarTransform4f
    scene = mi.load_dict({
        "type": "scene", "integrator": {"type": "volpath", "max_depth": -1, "rr_depth": 50},
        "sensor": {"type": "perspective", "fov": math.degrees(FOV), "near_clip": 1e-4,
                   # a millimetre ahead of the fog, as rays must enter it
                   "to_world": T().look_at([0, -1e-3, 0], [0, 1, 0], [0, 0, 1]), "sampler": {"type": "independent"},
                   "film": {"type": "hdrfilm", "width": SIZE, "height": SIZE, "rfilter": {"type": "box"},
                            "pixel_format": "luminance"}},
        "fog": {"type": "cube", "to_world": T().translate([0, 0.5, 0]).scale([HALF_BOX, 0.5, HALF_BOX]), "bsdf": {"type": "null"},
                "interior": {"type": "homogeneous", "albedo": float(asset.medium.albedo[0]), "sigma_t": float(tau),
                             "phase": {"type": "bakedphase", "filename": str(asset.path)}}},
        "light": {"type": "rectangle", "to_world": T().look_at([0, 1 - 1e-5, 0], [0, 0, 0], [0, 0, 1]).scale(HALF_LIGHT),
                  "bsdf": {"type": "diffuse", "reflectance": 0.0}, "emitter": {"type": "area", "radiance": 1.0}}})
    passes = max(1, round(samples / per_pass))
    total = sum(np.array(mi.render(scene, spp=per_pass, seed=seed * 100_003 + i), float)[..., 0] for i in range(passes)) / passes
    turned = [np.rot90(total, k) for k in range(4)]
    return np.mean(turned + [each.T for each in turned], axis=0)


def references(asset, samples, path):
    if path and Path(path).exists():
        with np.load(path) as stored:
            return {tau: stored[str(tau)] for tau in TAUS}
    from renderers.mitsuba import variants

    print("variant:", variants.activate("mono", None)[0])
    import renderers.mitsuba  # noqa: F401  registers the phase function

    found = {}
    for tau in TAUS:
        start = time.perf_counter()
        found[tau] = np.stack([traced(asset, tau, SHARE[tau] * samples / 2, seed) for seed in (1, 2)])
        print(f"density {tau}: {SHARE[tau] * samples:.0f} samples a pixel, {time.perf_counter() - start:.0f} s", flush=True)
    if path:
        np.savez(path, **{str(tau): halves for tau, halves in found.items()})
    return found


def filtered(asset, tau):
    """name -> picture (SIZE, SIZE) by the filter."""
    from dataclasses import replace

    from renderers.fog import filter as screen
    from renderers.fog import kernels

    image, distance, angle = clear()
    pictures = {}
    for name, (kernel, energy) in NAMED.items():
        fog = kernels.fog_of(asset, 1, kernel)
        fog = replace(fog, sigma_t=fog.sigma_t * tau, sigma_s=fog.sigma_s * tau)
        pictures[name] = screen.fogged(image[..., None], distance, angle, distance, distance, fog, outside="black",
                                       energy=energy)[..., 0]
    return pictures


def errors(picture, halves, straight):
    """Error of the whole picture, of the scattered light, of that in the middle; and the reference's noise in these measures."""
    third = slice(SIZE // 3, SIZE - SIZE // 3)
    found, noise = [], []
    for part, direct in ((slice(None), 0 * straight), (slice(None), straight), (third, straight)):
        first, second, own = ((each - direct)[part, part] for each in (halves[0], halves[1], picture))
        reference = (first + second) / 2
        variance, scale = np.mean((first - second) ** 2) / 4, math.sqrt(np.mean(reference**2))
        found.append(math.sqrt(max(np.mean((own - reference) ** 2) - variance, 0)) / scale)
        noise.append(math.sqrt(variance) / scale)
    return found, noise


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("asset")
    parser.add_argument("--samples", type=int, default=sized(8192, 8), help="a pixel at density 5")
    parser.add_argument("--reference", help="file of the path tracer's pictures, .npz")
    parser.add_argument("--pictures", help="file of a sheet, .png")
    options = parser.parse_args()
    import bakery

    asset = bakery.open(options.asset)
    found = references(asset, options.samples, options.reference)
    image, distance, _ = clear()
    print("| density | " + " | ".join(NAMED) + " | noise of the reference |\n|" + "---|" * (len(NAMED) + 2))
    sheet = []
    for tau, halves in found.items():
        pictures, straight = filtered(asset, tau), image * np.exp(-tau * distance)
        table = {name: errors(picture, halves, straight) for name, picture in pictures.items()}
        rows = [error for error, _ in table.values()] + [table["transport, flux"][1]]
        print(f"| {tau} | " + " | ".join(" / ".join(f"{100 * e:.1f}" for e in row) for row in rows) + " |")
        mean = {name: picture.sum() / halves.mean(axis=0).sum() for name, picture in pictures.items()}
        print(f"light over the reference's, density {tau}: " + "; ".join(f"{name} {m:.3f}" for name, m in mean.items()))
        found_rows = [(each - straight)[SIZE // 2 - 1] for each in (pictures["transport, flux"], halves.mean(axis=0))]
        across = np.divide(*(row[:SIZE // 2].reshape(-1, SIZE // 8).sum(axis=1) for row in found_rows))
        print("the first one over the reference from the left edge to the middle: " + ", ".join(f"{r:.2f}" for r in across))
        sheet.append((tau, {"path tracing": halves.mean(axis=0)} | pictures))
    if options.pictures:
        draw(sheet, options.pictures)


def draw(sheet, path):
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    columns = len(sheet[0][1])
    figure, axes = plt.subplots(len(sheet), columns, figsize=(1.7 * columns, 1.75 * len(sheet) + 0.3), facecolor="white")
    for number, (row, (tau, pictures)) in enumerate(zip(axes, sheet)):
        bright = np.quantile(pictures["path tracing"], 0.98)
        for axis, (name, picture) in zip(row, pictures.items()):
            grey = np.clip(picture / bright, 0, 1)[..., None] * np.array([1, 0.06, 0.03])
            axis.imshow(np.where(grey < 0.0031308, 12.92 * grey, 1.055 * np.maximum(grey, 1e-9) ** (1 / 2.4) - 0.055))
            axis.set(xticks=[], yticks=[])
            if number == 0:
                axis.set_title(name.replace(" (", "\n(").replace(", ", ",\n"), fontsize=8)
        row[0].set_ylabel(f"{tau} mean free path{'s' if tau > 1 else ''}", fontsize=8)
    figure.tight_layout(pad=0.4)
    figure.savefig(path, dpi=130)


if __name__ == "__main__":
    main()
