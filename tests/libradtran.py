"""Files of optical properties as libRadtran's tools write them."""

import numpy as np
from scipy.io import netcdf_file


def libradtran(path, hum=None, reff=None, classic=True, **changes):
    """A file as libRadtran's tools write them: Henyey-Greenstein lobes, extinction 100 km^-1/(g/m^3) at the first place, 200 at
    the second and so on, single precision angles."""
    wavelen, places = np.array([0.5, 0.6]), np.array(hum if reff is None else reff, float)
    theta = np.concatenate([np.linspace(0, 5, 200, endpoint=False), np.linspace(5, 180, 400)]).astype(np.float32)
    g = 0.5 + 0.1 * np.arange(places.size)[None] + 0.05 * np.arange(2)[:, None]
    mu = np.cos(np.radians(theta.astype(float)))
    phase = ((1 - g**2)[..., None] / (1 + g[..., None] ** 2 - 2 * g[..., None] * mu) ** 1.5).astype(np.float32)
    shape = (2, places.size, 1)
    values = {"wavelen": wavelen, "reff" if reff else "hum": places, "ntheta": np.full(shape, theta.size, np.int32),
              "theta": np.broadcast_to(theta, (*shape, theta.size)), "phase": phase[:, :, None],
              "ext": 100.0 * (1 + np.arange(places.size)) * np.ones((2, 1)), "ssa": np.full((2, places.size), 0.9)} | changes
    values = {name: value for name, value in values.items() if value is not None}
    names = {"wavelen": ("nlam",), "reff": ("n",), "hum": ("n",), "ntheta": ("nlam", "n", "p"), "theta": ("nlam", "n", "p", "a"),
             "phase": ("nlam", "n", "p", "a"), "ext": ("nlam", "n"), "ssa": ("nlam", "n")}
    units = {"wavelen": "micrometer", "reff": "micrometer", "ext": "km^-1/(g/m^3)"}
    if not classic:
        import h5py

        with h5py.File(path, "w") as file:
            for name, value in values.items():
                file.create_dataset(name, data=value, compression="gzip" if np.ndim(value) > 1 else None)
                file[name].attrs["units"] = np.bytes_(units.get(name, "-"))
        return path
    with netcdf_file(path, "w") as file:
        for name, value in values.items():
            for dimension, size in zip(names[name], np.shape(value), strict=True):
                if dimension not in file.dimensions:
                    file.createDimension(dimension, size)
            file.createVariable(name, np.asarray(value).dtype, names[name])[:] = value
            file.variables[name].units = units.get(name, "-")
    return path
