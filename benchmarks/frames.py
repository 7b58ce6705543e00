"""How much denoised frames flicker with the same random numbers in all frames, and with fresh ones in each.

    python -m benchmarks.frames

A ball of wax above a chequered floor, seen by a camera that passes by: by a quarter of a pixel a frame, by one, by four.  Flicker
is the root mean square of what a frame's error differs from that of the frame before, over all pixels and pairs of frames; error
the root mean square of the difference from a long render.  Both are of the luminance of what the PNG shows, 0 to 1.
"""

import tempfile
from pathlib import Path

import numpy as np

import bakery
from bakery.physics.shapes.radial import icosphere
from bakery.store import ply
from benchmarks.sizes import sized
from renderers import colour, sequence
from renderers.mitsuba import bitmaps
from renderers.pictures import denoise, images

PIXELS, SAMPLES, REFERENCE, FRAMES = sized((96, 16, 1024, 7), (16, 4, 8, 2))
SPEEDS = sized((0.25, 1.0, 4.0), (1.0,))  # pixels a frame
PIXEL = 19 * 2 * np.tan(np.radians(20)) / PIXELS  # mm, where the ball is

RECIPE = """\
bakery: 1
name: wax
wavelengths: [0.45, 0.55, 0.65]
tolerance: 10%
medium: {albedo: [0.8, 0.95, 0.99], mean_free_path: 1 mm, phase: {type: hg, g: 0}}
"""
SCENE = """\
bakery_scene: 2
name: pass
scene: {{mitsuba: lit.xml, unit: 1 mm}}
camera: {{origin: [0, -19, 5] mm, target: [0, 0, 0] mm, fov: 40 deg}}
film: {{width: {pixels}, height: {pixels}}}
stop: {{samples: {samples}}}
materials:
  - {{where: {{shape: ball}}, asset: wax.h5, method: paths}}
frames:
  count: {count}
  camera.origin: {{from: [0, -19, 5] mm, to: [{far:.6g}, -19, 5] mm}}
"""
XML = """<scene version="3.0.0">
<shape type="ply" id="ball"><string name="filename" value="ball.ply"/><bsdf type="dielectric"/></shape>
<shape type="rectangle"><transform name="to_world"><scale value="40"/><translate z="-5.3"/></transform><bsdf type="diffuse">
  <texture type="checkerboard" name="reflectance"><transform name="to_uv"><scale value="12"/></transform></texture></bsdf></shape>
<shape type="rectangle"><transform name="to_world"><scale value="2"/><rotate x="1" angle="180"/>
  <translate x="6" y="-6" z="14"/></transform><emitter type="area"><rgb name="radiance" value="40 38 30"/></emitter></shape>
<emitter type="constant"><rgb name="radiance" value="0.2 0.25 0.3"/></emitter></scene>
"""


def rendered(folder, name, seed=0, **settings):
    """Luminance (frames, H, W) of what the PNGs of a sequence show, by the layers without noise where there are any."""
    overrides = {key.replace("__", "."): value for key, value in settings.items()}
    report = sequence.render(folder / "s.yaml", folder / f"{name}.png", overrides=overrides, options={"seed": seed})
    shown = []
    for row in report["frames"]:
        channels, _ = bitmaps.read(row["files"][1])
        prefix = denoise.PREFIX if f"{denoise.PREFIX}R" in channels else ""
        picture = np.stack([channels[f"{prefix}{part}"] for part in "RGB"], axis=-1)
        shown.append(images.shown(picture, "reinhard")[0] @ colour.LUMINANCE)
    return np.array(shown, float)


def measured(folder: Path):
    """Prints flicker and error of frames in a folder."""
    vertices, faces = icosphere(320)
    (folder / "ball.ply").write_bytes(ply.mesh(5 * vertices, faces, single=True))
    (folder / "wax.yaml").write_text(RECIPE)
    (folder / "lit.xml").write_text(XML)
    bakery.bake(folder / "wax.yaml", output=folder / "wax.h5", stages=["medium"])
    without = denoise.fault()
    print(f"without the filter: {without}" if without else "flicker and error over white")
    for speed in SPEEDS:
        (folder / "s.yaml").write_text(SCENE.format(pixels=PIXELS, samples=SAMPLES, count=FRAMES,
                                                    far=(FRAMES - 1) * speed * PIXEL))
        reference = rendered(folder, "reference", 99, denoise="no", stop__samples=str(REFERENCE))
        for wish in ("no",) if without else ("yes", "no"):
            for noise in ("same", "fresh"):
                error = rendered(folder, "trial", denoise=wish, frames__noise=noise) - reference
                flicker = np.sqrt(np.mean(np.diff(error, axis=0) ** 2))
                print(f"{speed:4g} pixels a frame, denoise: {wish:3s}, noise: {noise:5s}: flicker {flicker:.4f}, "
                      f"error {np.sqrt(np.mean(error**2)):.4f}", flush=True)


def main():
    with tempfile.TemporaryDirectory() as folder:
        measured(Path(folder))


if __name__ == "__main__":
    main()
