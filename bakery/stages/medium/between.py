"""The group `medium` at wavelengths between the baked ones: a medium like those, whose errors say what the interpolation adds."""

import numpy as np

from bakery.physics.medium import spectral
from bakery.physics.medium.quantities import albedo_error
from bakery.physics.medium.spectral import Places
from bakery.stages.coordinates import BIAS, ERROR, stated_error
from bakery.stages.medium.outputs import members_of
from bakery.stages.optics.elements import ELEMENTS
from bakery.store.tree import Dataset, Group

_NEEDED = {"sigma_s", "sigma_a", "theta", "phase"}


def at_wavelengths(medium: Group, stored: np.ndarray, wanted: np.ndarray) -> Group:
    """The group at wavelengths (W,) um within the stored ones (L,).

    Scattering and absorption coefficient and each angle of the phase function go as powers of the wavelength between its
    neighbours (`spectral`), the other elements by their ratio to it; all else follows from those as at the stored ones.  `X_bias`
    is what X was off by, or else the stage's error, and what the interpolation adds; not a number where that is not known.
    """
    values = {name: member.data for name, member in medium.members.items()
              if isinstance(member, Dataset) and member.data.dtype.kind == "f" and member.data.shape[:1] == stored.shape
              and not name.endswith((ERROR, BIAS)) and name != "theta"}
    at = spectral.places(stored, wanted)
    theta, figures = medium["theta"].data, _figures(at, medium, values)
    members = dict(medium.members)
    for name, data in figures.items():
        whole = medium[name]
        over_angles = data.ndim == 2 and data.shape[1] == theta.size
        missed = spectral.missed(stored, wanted, lambda around, name=name: _figures(around, medium, values)[name], whole.data,
                                 over_angles)
        members[name] = Dataset(data, whole.units, whole.description, whole.choices)
        if name + ERROR in members:
            members[name + ERROR] = _like(members[name + ERROR], spectral.interpolated(at, members[name + ERROR].data))
        stated = _stated(medium, name, at, data)
        members[name + BIAS] = Dataset(stated + missed, whole.units, f"error of {name}, that of the interpolation with it")
    if "sigma_a_bias" in medium.members:  # of particles: the albedo is as good as the two coefficients
        scattered = np.divide(members["sigma_s_bias"].data, figures["sigma_s"], out=np.zeros_like(figures["sigma_s"]),
                              where=figures["sigma_s"] > 0)
        error = albedo_error(figures["albedo"], figures["sigma_t"], scattered, members["sigma_a_bias"].data)
        members["albedo_bias"] = _like(members["albedo_bias"], error)
    return Group(members, medium.attributes)


def can(medium) -> bool:
    """Whether a group has what a medium between wavelengths is made of."""
    return isinstance(medium, Group) and medium.members.keys() >= _NEEDED


def _figures(at: Places, medium: Group, values: dict) -> dict[str, np.ndarray]:
    """Every figure of a medium at places."""
    theta = medium["theta"].data
    first = spectral.phase_functions(at, theta, values["phase"])
    elements = [first]
    if "s11" in values:
        table = values["phase"]
        for name in ELEMENTS:
            ratio = np.divide(values[name], table, out=np.zeros_like(table), where=table > 0)
            elements.append(spectral.interpolated(at, ratio) * first)
    coefficients = [spectral.interpolated(at, values[name]) for name in ("sigma_s", "sigma_a")]
    figures = {name: member.data for name, member in members_of(*coefficients, theta, np.stack(elements, axis=1)).items()}
    figures = {name: data for name, data in figures.items() if name in values}
    return figures | {name: spectral.interpolated(at, data) for name, data in values.items() if name not in figures}


def _stated(medium: Group, name: str, at: Places, data: np.ndarray) -> np.ndarray:
    """The systematic error at places that is known of a figure without interpolation."""
    if name + BIAS in medium.members:
        return spectral.interpolated(at, medium[name + BIAS].data)
    if name == "cdf" or stated_error(medium, name) is not None:
        return np.zeros_like(data)
    reached = float(medium.attributes.get("achieved_error", 0.0))
    return reached * np.abs(data)


def _like(dataset: Dataset, data: np.ndarray) -> Dataset:
    return Dataset(data, dataset.units, dataset.description, dataset.choices)
