"""Fog in screen space on a graphics card: time of a frame, and how far it is from the processor's.

    python -m benchmarks.screen_gpu --keep build/screen.npz           # here: a frame, its fog, and what `fogged` makes of it
    python -m benchmarks.screen_gpu build/screen.npz --backend cuda   # there: milliseconds a frame, and the differences

The second one needs numpy, scipy, numba and drjit alone.  A frame begins with arrays of NumPy, and has ended when the picture is
complete on the card; `with copy`: when it is an array of NumPy again.
"""

import argparse
import dataclasses
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.sizes import sized
from renderers.fog import kernels

_INPUTS = ("image", "distance", "angle", "column", "lever")


def keep(path, height, width):
    """A frame, its medium and its picture by `filter.fogged` with points at every pixel."""
    import bakery
    from benchmarks.screen import RECIPE, scene
    from renderers.fog import filter as screen

    with tempfile.TemporaryDirectory() as folder:
        recipe = Path(folder, "fog.yaml")
        recipe.write_text(RECIPE)
        fog = kernels.fog_of(bakery.open(bakery.bake(recipe, output=recipe.with_suffix(".h5"))))
    inputs = {name: np.asarray(value, np.float64 if name == "distance" else np.float32)
              for name, value in zip(_INPUTS, scene(height, width))}
    start = time.process_time()
    picture = screen.fogged(*inputs.values(), fog, points="every pixel")
    print(f"every pixel, processor: {time.process_time() - start:.2f} s")
    medium = {field.name: getattr(fog, field.name) for field in dataclasses.fields(fog) if getattr(fog, field.name) is not None}
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savez_compressed(path, picture=picture, **inputs, **{f"fog_{name}": value for name, value in medium.items()})


def measure(path, backend, frames):
    """Prints milliseconds a frame, and the differences."""
    from renderers.fog import on_drjit

    with np.load(path) as kept:
        medium = {field.name: kept.get(f"fog_{field.name}") for field in dataclasses.fields(kernels.Fog)}
        inputs, picture = [kept[name] for name in _INPUTS], kept["picture"]
    import drjit as dr

    start = time.perf_counter()
    screen = on_drjit.Filter(kernels.Fog(**medium), picture.shape[2], backend=backend)
    found = screen.fogged(*inputs).numpy()
    print(f"{picture.shape[1]} x {picture.shape[0]}, {backend}: first frame, compiling: {time.perf_counter() - start:.2f} s")
    times = []
    for _ in range(frames):
        start = time.perf_counter()
        seen = screen.fogged(*inputs)
        dr.eval(seen)
        dr.sync_thread()
        on_card = time.perf_counter()
        seen.numpy()
        times.append((on_card - start, time.perf_counter() - start))
    alone, copied = 1000 * np.array(times).T
    print(f"a frame: median {np.median(alone):.1f} ms, least {alone.min():.1f}, most {alone.max():.1f}; with copy "
          f"{np.median(copied):.1f}")
    off = abs(found - picture)
    print(f"against the processor: largest {off.max():.2e}, mean {off.mean():.2e}, root mean square "
          f"{np.sqrt(np.square(off).mean()) / picture.mean():.2e} of the picture's mean; that is {picture.mean():.4f}, the "
          f"brightest pixel {picture.max():.3g}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", nargs="?", type=Path, help="as --keep wrote it")
    parser.add_argument("--keep", type=Path, help="where the frame goes, .npz")
    parser.add_argument("--size", type=int, nargs=2, default=sized((640, 480), (16, 12)), metavar=("WIDTH", "HEIGHT"))
    parser.add_argument("--backend", default="llvm", choices=("cuda", "llvm"))
    parser.add_argument("--frames", type=int, default=sized(20, 1))
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        path = asked.file or asked.keep or Path(folder, "screen.npz")
        if asked.file is None:
            keep(path, *asked.size[::-1])
        if asked.keep is None:
            measure(path, asked.backend, asked.frames)


if __name__ == "__main__":
    main()
