"""Assets for tests of renderers, written through the store: a medium with the phase functions that a test asks for."""

import numpy as np

from bakery.physics.medium.phase import normalised
from bakery.stages.medium.stage import members_of
from bakery.store.tree import Dataset, Group, text
from bakery.store.write import write

RGB = (0.61, 0.55, 0.465)


def henyey_greenstein(g, theta):
    """(L, A) 1/sr for (L,) g."""
    g = np.atleast_1d(np.asarray(g, dtype=float))[:, None]
    return (1 - g**2) / (4 * np.pi * ((1 - g) ** 2 + 4 * g * np.sin(np.asarray(theta) / 2) ** 2) ** 1.5)


def angles(count=600, first=1e-4):
    """From 0 to pi, geometric near the forward direction."""
    return np.concatenate([[0.0], np.geomspace(first, 0.2, count // 2), np.linspace(0.2, np.pi, count // 2)[1:]])


def asset_file(path, phase, *, theta=None, wavelength=(0.55,), sigma_t=1.0, albedo=1.0, elements=None, name="test"):
    """Writes an asset whose `medium` holds (L, A) phase functions on `theta`; returns its path as text.

    `elements` : {"s12": (L, A), ...}, in the scale of `phase`.
    """
    theta = angles() if theta is None else theta
    phase = np.atleast_2d(phase)
    table, scale = normalised(theta, phase)
    count = len(wavelength)
    sigma_t, albedo = (np.broadcast_to(np.asarray(value, dtype=float), (count,)).copy() for value in (sigma_t, albedo))
    members = members_of(albedo * sigma_t, (1 - albedo) * sigma_t, np.asarray(theta, dtype=float), table[:, None],
                         sigma_t, albedo)
    for key, value in (elements or {}).items():
        members[key] = Dataset(np.atleast_2d(value) * (table[:, :1] / phase[:, :1]), "1/sr", "Mueller element")
    stage = {"stage": "medium", "stage_version": 1, "input_hash": "0" * 64, "tolerance": 0.01, "achieved_error": 0.001,
             "error_measure": "none"}
    write(path, Group({"recipe": text("bakery: 1\n", "recipe"),
                       "wavelength": Dataset(np.asarray(wavelength, dtype=float), "um", "wavelengths"),
                       "medium": Group(members, stage)}, {"name": name, "bakery_version": "0.1.0"}))
    return str(path)
