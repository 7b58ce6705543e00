"""Plane layers: python -m benchmarks.surface [--small]

Isotropic half spaces against Chandrasekhar's H functions; energy of lossless layers; moments, processor time and bytes that three
half spaces take at 1 %, and the change that is stated against the true error; PythonicDISORT at equal error, where it is
installed; look-ups of shipped surfaces in numba and in Dr.Jit; how far light spreads; what half spaces of packed balls take.
"""

import importlib.util
import math
import tempfile
import time
import warnings
from pathlib import Path

import numpy as np
from numba import njit

import bakery
from bakery.kernels import surface_reflectance
from bakery.physics.medium import analytic
from bakery.physics.multiple.legendre import moments
from bakery.physics.surfaces.refine import refined
from bakery.physics.surfaces.slab import Slab
from bakery.physics.surfaces.solution import solve
from bakery.physics.surfaces.spread import profile, spread
from bakery.system import blas
from benchmarks.sizes import sized

ROOT = Path(__file__).resolve().parents[1]
ALBEDOS = sized((0.1, 0.5, 0.9, 0.99, 0.9999, 1.0), (0.9, 1.0))
DEPTHS = sized((1e-6, 0.01, 1.0, 100.0, 1e6, math.inf), (1.0,))
INDICES = sized((0.8, 1.0, 1.33, 1.5), (1.33,))
LOBES = sized((0.0, 0.6, 0.75, 0.85, 0.9), (0.6,))
# albedo, g and index of half spaces
SPREADS = sized(((0.9, 0.5, 1.0), (0.99, 0.5, 1.0), (0.999, 0.5, 1.0), (0.9999, 0.5, 1.0), (1.0, 0.5, 1.0), (0.99, 0.9, 1.0),
                 (8.5 / 8.5011, 0.7, 1.33), (12.57 / 12.584, 0.7, 1.33)), ((0.9, 0.5, 1.0),))
GRAINS = sized({"matt 0.1": 0.1, "matt 0.8": 0.8, "matt 1": 1.0, "glass 1.5": 1.5}, {"matt 0.8": 0.8})
SHIPPED = sized(("snow_field", "beach_sand", "white_paint", "milk_jug", "soil", "thin_snow"), ("soil",))
LOOK_UPS = sized(1 << 20, 1 << 10)
ERRORS = sized((0.02, 0.01), (0.1,))
AZIMUTHS = np.linspace(0, math.pi, 5)
FAR = 1e5  # optical depth of a half space of PythonicDISORT
COSINES = np.array([math.cos(math.radians(89.9)), 0.05, 0.2, 0.5, 0.8, 1.0])


def henyey_greenstein(g):
    theta, values, _, _ = analytic.tabulated("hg", 1e-3, 1, g=[g])
    return theta, values[0]


def h_function(albedo: float, mu, count: int = 400):
    """Chandrasekhar's H by iteration over its non-linear equation, at any cosines."""
    x, weight = np.polynomial.legendre.leggauss(count)
    x, weight = (0.5 * (1 + x)) ** 3, 1.5 * (0.5 * (1 + x)) ** 2 * weight
    root, H = math.sqrt(1 - albedo), np.ones(count)
    for _ in range(20000):
        new = 1 / (root + 0.5 * albedo * (x / (x[:, None] + x)) @ (weight * H))
        if np.abs(new - H).max() < 1e-13:
            break
        H = 0.5 * (H + new)
    return 1 / (root + 0.5 * albedo * (x / (mu[:, None] + x)) @ (weight * H))


def half_spaces():
    sphere = np.array([0.0, math.pi]), np.full(2, 0.25 / math.pi)
    print("isotropic half space, 64 moments: largest relative error of the reflectance, angles to 89.9 degrees")
    for albedo in ALBEDOS:
        H = h_function(albedo, COSINES)
        exact = albedo / 4 * H[:, None] * H / (COSINES[:, None] + COSINES)
        value = solve(Slab(*sphere, albedo, math.inf), np.eye(65)[0], 64).reflection(COSINES[:, None], COSINES, 0.0)
        print(f"  albedo {albedo:<7g} {np.abs(value / exact - 1).max():.1e}")


def energy():
    theta, phase = henyey_greenstein(0.85)
    worst = 0.0
    for depth in DEPTHS:
        for index in INDICES:
            solution = solve(Slab(theta, phase, 1.0, depth, index), moments(theta, phase, 49), 48, 1.0)
            worst = max(worst, float(np.abs(solution.albedo + solution.passed - 1).max()))
    print(f"lossless layers, {len(DEPTHS)} depths, {len(INDICES)} indices: energy holds to {worst:.1e}")


def cost():
    print("three half spaces (albedos 0.9, 0.99, 1) to 1 %: moments, orders, stated change, true error, CPU s, MB")
    for g in LOBES:
        theta, phase = henyey_greenstein(g)
        slabs = [Slab(theta, phase, albedo, math.inf) for albedo in (0.9, 0.99, 1.0)]
        start = time.process_time()
        solutions = [refined(slab, 0.01) for slab in slabs]
        seconds = time.process_time() - start
        solution, change = solutions[-1]
        count = len(solution.cut.moments)
        at = np.meshgrid(COSINES, COSINES, AZIMUTHS, indexing="ij")
        finer = solve(slabs[-1], moments(theta, phase, 2 * count + 1), 2 * count, 1e-4).reflection(*at)
        error = np.abs(solution.reflection(*at) / finer - 1).max()
        nodes = len(solution.albedo)
        size = 4e-6 * sum(len(each.reflected) for each, _ in solutions) * nodes * (nodes + 1) / 2
        print(f"  g {g:<5g} {count:4d} {len(solution.reflected):4d}  {change:.1e}  {error:.1e}  {seconds:6.2f}  {size:.2f}")


def fog():
    """Angles, phase function and single-scattering albedo of the shipped fog at 0.55 um."""
    with tempfile.TemporaryDirectory() as folder:
        medium = bakery.open(bakery.bake(ROOT / "recipes" / "fog.yaml", output=Path(folder) / "fog.h5")).medium
    return medium["theta"], medium["phase"][1], float(medium["sigma_s"][1] / medium["sigma_t"][1])


def peer():
    if importlib.util.find_spec("PythonicDISORT") is None:
        print("PythonicDISORT is not installed: left out")
        return
    print("half spaces to 1 %: bakery's true error to 89.9 degrees; by streams bakery's CPU s for every incidence, in turns with")
    print("PythonicDISORT's for one, its error to 87 degrees; bakery's time over that of eight where that error is 1 % or below")
    for name, (theta, phase, albedo), streams in (
            ("HG 0.75, 0.99", (*henyey_greenstein(0.75), 0.99), sized((32, 48, 64), (16, 32))),
            *sized((("HG 0.9, 0.99", (*henyey_greenstein(0.9), 0.99), (64, 96, 128)), ("fog", fog(), (128, 192, 256))), ())):
        slab = Slab(theta, phase, albedo, math.inf)
        solution, _ = refined(slab, 0.01)  # compiles
        count = len(solution.cut.moments)
        lobe = moments(theta, phase, 2 * count + 200)
        at = np.meshgrid(COSINES, COSINES, AZIMUTHS, indexing="ij")
        exact = solve(slab, lobe, 2 * count, 1e-4).reflection(*at)
        print(f"  {name}: true error {np.abs(solution.reflection(*at) / exact - 1).max():.2%}")
        for number in streams:
            ours, theirs, error = [], [], 0.0
            for k in [*range(1, len(COSINES) - 1)] * sized(1 if number > 100 else 4, 1):  # in turns
                start = time.process_time()
                refined(slab, 0.01)
                ours.append(time.process_time() - start)
                seconds, off = disort(slab, lobe, number, k, exact[1:-1, k])
                theirs, error = [*theirs, seconds], max(error, off)
            seconds, their_seconds = np.median(ours), np.median(theirs)
            ratio = f", {seconds / (8 * their_seconds):.3f}" if error <= 0.01 else ""
            print(f"    {number} streams: {seconds:.3f} s, {their_seconds:.3f} s, {error:.2%}{ratio}")


def disort(slab: Slab, lobe, streams: int, incident: int, exact):
    """Processor time, and largest error of the reflectance at COSINES but for the first and last, of PythonicDISORT."""
    from PythonicDISORT import pydisort, subroutines

    mu = COSINES[incident]
    start = time.process_time()
    with warnings.catch_warnings(action="ignore"):  # an albedo near 1, many Fourier orders
        *_, radiance = pydisort(np.array([FAR]), np.array([slab.albedo]), streams, lobe[None] / lobe[0], mu, 1.0, 0.0,
                                NLeg=streams, NFourier=streams, f_arr=np.maximum(lobe[[streams]], 0), NT_cor=True)
        at = subroutines.interpolate(radiance)
        values = np.stack([at(COSINES[1:-1], 0.0, phi) for phi in AZIMUTHS], axis=1) * math.pi / mu
    return time.process_time() - start, float(np.abs(values / exact - 1).max())


def spreads():
    spread(Slab(*henyey_greenstein(0.5), 0.5, math.inf), 0, 0, 0)  # compiles
    print("half spaces: albedo, g, index; root mean square, median and d of the profile in transport mean free paths, misfit,")
    print("share of the light further than 1000 of them, CPU s")
    for albedo, g, index in SPREADS:
        begun = time.process_time()
        result = spread(Slab(*henyey_greenstein(g), albedo, math.inf, index), 0, 0, 0)
        seconds, path = time.process_time() - begun, 1 / (1 - albedo * g)
        light = result.light.mean(axis=0).sum(axis=0)
        within = np.cumsum(light) / (light.sum() + result.beyond)
        width, misfit = profile(result.edges, light, result.beyond)
        error = 50 * result.mean_square_error / result.mean_square
        print(f"  {albedo:.5f} {g} {index}  {math.sqrt(result.mean_square) / path:.3g} +- {error:.1f} %  "
              f"{np.interp(0.5, within, result.edges[1:]) / path:.3g}  {width / path:.3g}  {100 * misfit:.1f} %  "
              f"{100 * result.beyond:.2f} %  {seconds:.2f}")


def grains():
    from bakery.physics.grains.sphere import ball
    from bakery.physics.grains.surface import dielectric, diffuse
    from bakery.physics.grains.traces import nodes
    from bakery.physics.granular.goniometer import Goniometer
    from bakery.physics.granular.packed import Grain
    from bakery.physics.granular.reflectance import measured
    from bakery.physics.medium import phase
    from bakery.physics.packing import pack

    print("packed balls, fraction 0.6, one wavelength: error asked for and stated, walks, hits, CPU s")
    tile = pack(0.6, np.ones(500), seed=1, schedule="draft")
    theta, edges = nodes()
    for name, surface in GRAINS.items():
        made = {"matt": diffuse, "glass": dielectric}[name.split()[0]](surface)
        figures = ball(made, 0.0, edges)
        lobe, _ = phase.normalised(theta, np.atleast_2d(figures.phase)[0])
        solution, _ = refined(Slab(theta, lobe, min(float(np.atleast_1d(figures.albedo)[0]), 1.0), math.inf), 0.05)
        for seed, tolerance in enumerate((0.2, *ERRORS)):  # the first compiles
            goniometer = Goniometer(tile.centers, tile.radii, tile.cell, [Grain(made)], mu=np.zeros((1, 1)), seed=seed,
                                    channels=made.channels[None], g=float(np.atleast_1d(figures.g)[0]))
            start = time.process_time()
            result = measured(goniometer, [solution], tolerance)
            if seed:
                print(f"  {name:<10} {tolerance:6.1%} {result.achieved_error:6.2%}  {result.walks:.1e}  {result.hits:.1e}  "
                      f"{time.process_time() - start:6.1f}")


def look_ups():
    print("ns of processor, pairs of directions without order: grid; numba, a wavelength, three; Dr.Jit (LLVM), three")
    random = np.random.default_rng(1)
    mu, mu0 = random.uniform(0.01, 1, (2, LOOK_UPS))
    phi = random.uniform(0, math.pi, LOOK_UPS)
    for name in SHIPPED:
        with tempfile.TemporaryDirectory() as folder:
            asset = bakery.open(bakery.bake(ROOT / "recipes" / f"{name}.yaml", output=Path(folder) / "surface.h5"))
            table, _ = asset.surface.table()
            at = table, mu, mu0, np.cos(phi)
            seconds = shortest([lambda: alone(*at), lambda: together(*at), of_plugin(asset, mu, mu0, phi)], sized(7, 1))
        print(f"  {name:<12} {table.reflected.shape[1]} x {table.reflected.shape[3]}  "
              + "  ".join(f"{1e9 * each / LOOK_UPS:4.0f}" for each in seconds))


def shortest(jobs, rounds: int):
    """Processor seconds of each job, the shortest of its turns after one that compiles."""
    seconds = np.full((rounds + 1, len(jobs)), math.inf)
    for row in seconds:
        for i, job in enumerate(jobs):
            start = time.process_time()
            job()
            row[i] = time.process_time() - start
    return seconds[1:].min(axis=0)


@njit(nogil=True, error_model="numpy")
def alone(table, mu, mu0, cos_phi):
    total, waves = 0.0, len(table.once)
    for q in range(len(mu)):
        total += surface_reflectance(table, q % waves, mu[q], mu0[q], cos_phi[q])
    return total


@njit(nogil=True, error_model="numpy")
def together(table, mu, mu0, cos_phi):
    total = 0.0
    for q in range(len(mu)):
        for wave in range(len(table.once)):
            total += surface_reflectance(table, wave, mu[q], mu0[q], cos_phi[q])
    return total


def of_plugin(asset, mu, mu0, phi):
    """A function that looks all pairs up as `bakedbsdf` does, on one core."""
    import renderers.mitsuba  # noqa: F401  # isort: skip  finds LLVM for Dr.Jit
    import drjit as dr
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    dr.set_thread_count(1)
    from renderers.mitsuba.layer_values import Values
    from renderers.mitsuba.layers import layer_of

    values = Values(layer_of(asset), -1, None)
    sine, sine0 = np.sqrt(1 - mu * mu), np.sqrt(1 - mu0 * mu0)
    wi = mi.Vector3f(np.stack([-sine0, 0 * sine0, mu0]).astype(np.float32))
    wo = mi.Vector3f(np.stack([sine * np.cos(phi), sine * np.sin(phi), mu]).astype(np.float32))
    dr.eval(wi, wo)

    def job():
        dr.eval(values.values(values.rows(None), values.pair(wi, wo), True))
        dr.sync_thread()

    return job


def main() -> None:
    with blas.one_thread():  # as in bakes
        half_spaces()
        energy()
        cost()
        peer()
        look_ups()
        spreads()
        grains()


if __name__ == "__main__":
    main()
