"""For the Python of an environment with Eradiate: polarisation of what a thin layer reflects, by its polarised mode.

    python eradiate_polarised.py FILE.nc      prints JSON: radiance I and Q of each direction
"""

import json
import sys

import eradiate
import numpy as np
from eradiate import unit_registry as ureg

ZENITHS = (-40.0, -10.0)  # deg, of directions on the side of the light; light from 60 degrees turns by 80 and 110
NM, SUN, SAMPLES = 500.0, 60.0, 200_000


def main(path):
    eradiate.set_mode("mono_polarized_double")
    layer = eradiate.experiments.AtmosphereExperiment(
        geometry={"type": "plane_parallel", "toa_altitude": 300 * ureg.m, "zgrid": np.linspace(0, 300, 7) * ureg.m},
        surface={"type": "lambertian", "reflectance": 0.0},
        atmosphere={"type": "heterogeneous", "molecular_atmosphere": None, "particle_layers": [
            {"dataset": path, "bottom": 50 * ureg.m, "top": 250 * ureg.m, "distribution": "uniform", "tau_ref": 0.01,
             "w_ref": NM * ureg.nm}]},
        illumination={"type": "directional", "zenith": SUN * ureg.deg, "azimuth": 0 * ureg.deg,
                      "irradiance": {"type": "uniform", "value": 1.0}},
        integrator={"type": "volpath", "stokes": True},
        measures=[{"type": "mdistant", "construct": "hplane", "zeniths": np.array(ZENITHS) * ureg.deg, "azimuth": 0 * ureg.deg,
                   "srf": {"type": "delta", "wavelengths": [NM] * ureg.nm}, "spp": SAMPLES}])
    stokes = eradiate.run(layer, seed_state=eradiate.rng.SeedState(1))["radiance"].squeeze().values
    print(json.dumps({"I": stokes[0].tolist(), "Q": stokes[1].tolist()}))


if __name__ == "__main__":
    main(*sys.argv[1:])
