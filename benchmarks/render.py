"""Time of `bakedphase` against Mitsuba's `hg` and `tabphase`, in one interleaved run.

    python benchmarks/render.py [--variant llvm_ad_mono] [--repeats 5]

The scene is a ball of optical radius 8, albedo 1, under a constant light.  All three hold the Henyey-Greenstein phase
function (g = 0.8), so paths have the same lengths and the time per sample is the time of the phase function alone.
"""

import argparse
import time
import types

import numpy as np

from benchmarks.sizes import sized

G = 0.8


def henyey_greenstein(theta):
    return (1 - G * G) / (4 * np.pi * ((1 - G) ** 2 + 4 * G * np.sin(theta / 2) ** 2) ** 1.5)


def asset(wavelengths, angles=1000):
    """What `bakery.open` would return for that medium."""
    theta = np.concatenate([[0.0], np.geomspace(1e-3, np.pi, angles - 1)])
    value = np.tile(henyey_greenstein(theta), (wavelengths, 1))
    one = np.ones(wavelengths)
    medium = types.SimpleNamespace(theta=theta, phase=lambda angle: value, sigma_t=one, albedo=one)
    wavelength = np.array([0.55]) if wavelengths == 1 else np.linspace(0.61, 0.465, wavelengths)
    return types.SimpleNamespace(wavelength=wavelength, medium=medium)


def scene(mi, phase, width):
    return mi.load_dict({
        "type": "scene", "integrator": {"type": "volpath", "max_depth": -1, "rr_depth": 1000}, "light": {"type": "constant"},
        "sensor": {"type": "perspective", "fov": 25, "to_world": mi.ScalarTransform4f().look_at([0, 0, 5], [0, 0, 0], [0, 1, 0]),
                   "film": {"type": "hdrfilm", "width": width, "height": width, "rfilter": {"type": "box"}}},
        "ball": {"type": "sphere", "bsdf": {"type": "null"},
                 "interior": {"type": "homogeneous", "sigma_t": 8.0, "albedo": 1.0, "sample_emitters": False, "phase": phase}}})


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--variant", default="llvm_ad_mono")
    parser.add_argument("--repeats", type=int, default=sized(5, 1))
    options = parser.parse_args()
    from renderers.mitsuba import tables, variants  # isort: skip  # before mitsuba: finds LLVM for it
    import mitsuba as mi

    variants.activate("mono", options.variant)
    tables.load = lambda path: tables.tables_from(asset(3 if path.endswith("3") else 1))
    cosine = np.linspace(-1, 1, 1000)
    phases = {"hg": {"type": "hg", "g": G},
              "tabphase": {"type": "tabphase", "values": ",".join(f"{v:.9g}" for v in henyey_greenstein(np.arccos(cosine)))},
              "bakedphase, 1 table": {"type": "bakedphase", "filename": "tables1"}}
    if mi.is_rgb:
        phases["bakedphase, 3 tables"] = {"type": "bakedphase", "filename": "tables3"}
    width, samples = (24, 4) if options.variant.startswith("scalar") else sized((128, 64), (8, 2))
    scenes = {name: scene(mi, phase, width) for name, phase in phases.items()}
    seconds = {name: [] for name in scenes}
    for repeat in range(options.repeats + 1):  # the first compiles
        for name, one in scenes.items():
            begin = time.perf_counter()
            np.array(mi.render(one, spp=samples, seed=repeat))
            seconds[name].append(time.perf_counter() - begin)
    print(f"{options.variant}, {width} x {width} pixels, {samples} samples, best of {options.repeats}")
    least = {name: min(times[1:]) for name, times in seconds.items()}
    for name, best in least.items():
        print(f"{name:22s} {best:8.3f} s  {1e9 * best / (width * width * samples):9.0f} ns/path  {best / least['hg']:5.2f} x hg")


if __name__ == "__main__":
    main()
