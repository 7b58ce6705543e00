"""For the Python of an environment with Eradiate: reflectance of a layer whose particle data are a file, and what it reads of it.

    python eradiate_scene.py FILE.nc LIBRADTRAN.cdf      prints JSON
"""

import json
import sys

import eradiate
import numpy as np
import xarray
from eradiate import unit_registry as ureg

RUNS, SAMPLES = 8, 40_000
ZENITHS = (-45.0, -10.0, 10.0, 45.0, 70.0)  # deg, on the side of the light below 0
NM, SUN, THICK = 550.0, 60.0, 200.0  # m


def layer(path, tau):
    """A plane-parallel atmosphere of nothing but the particles, over black ground."""
    return eradiate.experiments.AtmosphereExperiment(
        geometry={"type": "plane_parallel", "toa_altitude": 300 * ureg.m, "zgrid": np.linspace(0, 300, 7) * ureg.m},
        surface={"type": "lambertian", "reflectance": 0.0},
        atmosphere={"type": "heterogeneous", "molecular_atmosphere": None, "particle_layers": [
            {"dataset": path, "bottom": 50 * ureg.m, "top": (50 + THICK) * ureg.m, "distribution": "uniform", "tau_ref": tau,
             "w_ref": NM * ureg.nm}]},
        illumination={"type": "directional", "zenith": SUN * ureg.deg, "azimuth": 0 * ureg.deg,
                      "irradiance": {"type": "uniform", "value": 1.0}},
        measures=[{"type": "mdistant", "construct": "hplane", "zeniths": np.array(ZENITHS) * ureg.deg, "azimuth": 0 * ureg.deg,
                   "srf": {"type": "delta", "wavelengths": [NM] * ureg.nm}, "spp": SAMPLES}])


def main(path, libradtran):
    eradiate.set_mode("mono_double")
    particles = eradiate.radprops.ParticleProperties.convert(path)
    sigma_t = float(particles.eval_ext(NM * ureg.nm).m_as("1/m").item())
    converted = eradiate.data.convert.libradtran_to_aer_core_v2(xarray.load_dataset(libradtran).isel(nreff=0))
    mu, phase = particles.eval_phase(NM * ureg.nm)
    brf = [eradiate.run(layer(path, THICK * sigma_t), seed_state=eradiate.rng.SeedState(seed)).brf.values.reshape(-1)
           for seed in range(RUNS)]
    print(json.dumps({
        "sigma_t": sigma_t, "albedo": float(particles.eval_ssa(NM * ureg.nm).m.item()), "mu": mu.tolist(),
        "phase": np.asarray(phase).reshape(-1, len(mu))[0].tolist(), "brf": np.mean(brf, axis=0).tolist(),
        "error": (np.std(brf, axis=0, ddof=1) / RUNS**0.5).tolist(), "ext_of_libradtran": converted["ext"].values.tolist(),
        "phase_of_libradtran": converted["phase"].values[0].tolist(), "mu_of_libradtran": converted["mu"].values.tolist()}))


if __name__ == "__main__":
    main(*sys.argv[1:])
