"""Surfaces as CSV: reflectance over a grid of angles, and albedos."""

import math

import numpy as np

from bakery.draw.files import csv_text
from bakery.stages.surface.view import view
from bakery.store.tree import Group

INCIDENT = np.array([0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 85.0])
EXITANT = np.array([0.0, 5.0, 15.0, 25.0, 35.0, 45.0, 55.0, 65.0, 75.0, 85.0, 89.0])
AZIMUTHS = np.arange(0.0, 181.0, 15.0)


def csv_tables(root: Group) -> tuple[dict[str, str], set[str]]:
    """File name -> text for the group `surface`: one row a pair of directions, one column a wavelength and thickness.

    What is stored for the look-up, orders with their exponents, is told by these values.
    """
    surface, um = view(root), root["wavelength"].data
    thickness = surface.get("thickness")
    heads = [f"{x:g} um" + ("" if thickness is None or len(thickness) == 1 else f", {t:g} um thick")
             for x in um for t in (thickness if thickness is not None else [math.inf])]
    angles = [part.ravel() for part in np.meshgrid(INCIDENT, EXITANT, AZIMUTHS, indexing="ij")]
    columns = list(zip(("theta_in [deg]", "theta_out [deg]", "phi [deg]"), angles, strict=True))
    files = {}
    for name, function in (("reflected", surface.reflectance), ("transmitted", surface.transmittance)):
        if name in surface:
            values = function(*np.radians(angles)).reshape(len(heads), -1)
            files[f"surface_{name}.csv"] = csv_text(columns + [(f"{name} [1] at {head}", row) for head, row in
                                                               zip(heads, values, strict=True)])
    theta = np.append(np.arange(0.0, 90.0), 89.9)
    values = surface.albedo(np.radians(theta)).reshape(len(heads), -1)
    albedos = [(f"albedo [1] at {head}", row) for head, row in zip(heads, values, strict=True)]
    files["surface_albedo.csv"] = csv_text([("theta_in [deg]", theta), *albedos])
    told = ("reflected", "reflected_exponent", "transmitted", "transmitted_exponent", "albedo")
    return files, {f"surface/{name}" for name in told if name in surface}
