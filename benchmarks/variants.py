"""Whether a graphics card and processors make the same pictures, in scenes of bodies, media and fog.

    python -m benchmarks.variants [CASE …] [--longest 128] [--samples 2048,256] [-o build/variants]

A row a case: seconds and samples of the passes of either variant; the ratio of mean luminances and its standard error; squares of
the differences of 8 x 8 regions over their standard errors (1 where only noise differs), and the largest of them.  Random numbers
are others.  Fog's filter has no noise: the largest difference over the largest radiance, as processors sum blocks of pixels.
"""

import argparse
import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np

from benchmarks.first_picture import SCENES, settings
from benchmarks.sizes import SMALL, sized
from renderers import colour, scene
from renderers.mitsuba import bitmaps

ROOT = Path(__file__).resolve().parents[1]
TILES = 8
VARIANTS = ["llvm_ad_rgb"] * 2 if SMALL else ["cuda_ad_rgb", "llvm_ad_rgb"]
SKY = ('<emitter type="sunsky"><vector name="sun_direction" value="-0.5, -0.4, 0.7"/>'
       '<float name="sun_aperture" value="40"/></emitter>')
HAZE = """bakery: 1
name: haze
wavelengths: rgb
tolerance: 1%
medium: {albedo: [0.99, 0.98, 0.9], mean_free_path: "[90, 70, 60] mm", phase: {type: hg, g: 0.6}}
"""
WAX = f'{{where: {{shape: candle}}, recipe: "{ROOT}/recipes/wax.yaml", boundary: {{index: 1.446}}}}'
MATCHED = f'{{where: {{shape: head}}, recipe: "{ROOT}/recipes/marble.yaml"}}'
BOX = "{where: {box: {lo: [-200, -120, 0] mm, hi: [200, 120, 150] mm}}, recipe: haze.yaml}"
EVERYWHERE = "{where: everywhere, recipe: haze.yaml}"
CASES = {"bust": None, "candle": None, "head": None, "glass_of_milk": None, "milk_in_the_sun": ("glass_of_milk", None),
         "head_in_a_box_of_haze": ("bust", [MATCHED, BOX]), "candle_in_haze": ("candle", [WAX, EVERYWHERE]),
         "square_emitter": None}


def written(case, folder) -> Path:
    """The file of a scene that ships, or of one written beside others in a folder, made of such."""
    if not CASES[case]:
        return SCENES / f"{case}.yaml"
    shipped, entries = CASES[case]
    room = (SCENES / f"{shipped}.xml").read_text()
    room = re.sub(r'value="(\w+\.ply)"', lambda name: f'value="{SCENES / name[1]}"', room)
    text = (SCENES / f"{shipped}.yaml").read_text().replace("../../recipes", str(ROOT / "recipes"))
    if entries:
        text = text[:text.index("materials:")] + "materials: [{}]\n".format(", ".join(entries))
    else:
        room = re.sub(r"<shape[^\n]*emitter[^\n]*\n<emitter[^\n]*", SKY, room)
    (folder / "haze.yaml").write_text(HAZE)
    (folder / f"{shipped}.xml").write_text(room)
    (folder / f"{case}.yaml").write_text(text)
    return folder / f"{case}.yaml"


def rendered(path, picture, longest, samples, variant, seed):
    """Picture (H, W, 3), variance of its luminance (H, W) or None, and seconds and samples of the passes."""
    fog = scene.load(path, assets=False).section == "fog"
    chosen = {} if fog else settings(path, longest, False) | {"stop.samples": samples, "denoise": "no"}
    words = [word for key, value in chosen.items() for word in ("--set", f"{key}={value}")] + ["--seed", str(seed)] * (not fog)
    words += ["--variant", variant] if not fog or variant.startswith("cuda") else []
    done = subprocess.run([sys.executable, "-m", "bakery", "render", str(path), "-o", str(picture), "--json", "--overwrite",
                           *words], capture_output=True, text=True)
    if done.returncode not in (0, 3):
        sys.exit(f"{path}: {done.stderr.splitlines()[-1]}")
    report, channels = json.loads(done.stdout), bitmaps.read(picture.with_suffix(".exr"))[0]
    variance = None if fog else channels["noise.Y"].astype(float) ** 2
    rgb = np.stack([channels[name] for name in "RGB"], -1).astype(float)
    return rgb, variance, report["seconds"].get("passes", report["seconds"]["total"]), report["samples"]


def compared(case, folder, longest, samples) -> str:
    """The row of a case."""
    path = written(case, folder)
    pictures = [rendered(path, folder / f"{case}.{number}.png", longest, count, variant, number)
                for number, (variant, count) in enumerate(zip(VARIANTS, samples, strict=True))]
    begin = f"| {case} | {' | '.join(f'{seconds:.1f} s, {count}' for *_, seconds, count in pictures)} |"
    (first, first_variance, *_), (second, second_variance, *_) = pictures
    if first_variance is None:
        return f"{begin} {np.abs(first - second).max() / second.max():.1e} |"
    means = [tiles(rgb @ colour.LUMINANCE) for rgb in (first, second)]
    variance = sum(tiles(image) / (image.size / TILES**2) for image in (first_variance, second_variance))
    z = (means[0] - means[1]) / np.sqrt(variance)
    error = np.sqrt(variance.sum()) / TILES**2 / means[1].mean()
    return f"{begin} {means[0].mean() / means[1].mean():.4f} ± {error:.4f} | {np.mean(z**2):.2f} | {np.abs(z).max():.1f} |"


def tiles(image):
    """Means (TILES, TILES) of what divides an image (H, W) whose sides it divides."""
    height, width = image.shape
    return image.reshape(TILES, height // TILES, TILES, width // TILES).mean(axis=(1, 3))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("cases", nargs="*", help=f"of {', '.join(CASES)}")
    parser.add_argument("--longest", type=int, default=sized(128, 16))
    parser.add_argument("--samples", default=sized("2048,256", "8,4"), help="of the card, and of processors")
    parser.add_argument("-o", "--output", type=Path, default=Path("build/variants"))
    chosen = parser.parse_args()
    folder = chosen.output.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    print("| case | passes of the card | of processors | ratio of means | squares of differences | the largest |\n"
          "|---|---|---|---|---|---|")
    for case in chosen.cases or (["bust"] if SMALL else CASES):
        print(compared(case, folder, chosen.longest, [int(count) for count in chosen.samples.split(",")]), flush=True)


if __name__ == "__main__":
    main()
