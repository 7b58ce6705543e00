"""Legendre moments of a medium's phase function, expansion coefficients of its scattering matrix, their errors, what is cut."""

from collections.abc import Mapping

import numpy as np

from bakery.errors import UsageError
from bakery.grammar.units import FRACTION, NUMBER_ONLY
from bakery.physics.medium.phase import phase_integral
from bakery.physics.moments import (
    MOST,
    Expansion,
    Series,
    expansion_coefficients,
    legendre_moments,
    legendre_series,
    series_error,
)
from bakery.stages.coordinates import stated_error
from bakery.stages.declaration import Answer, Query, Remark, lists_of
from bakery.stages.optics.elements import ELEMENTS
from bakery.store.tree import Group

COEFFICIENTS = ("alpha1", "alpha2", "alpha3", "alpha4", "beta1", "beta2")
_LARGEST = 65536  # orders that may be asked for


def moments(medium: Group, orders=None, tolerance=None) -> Series:
    """So many Legendre moments of a group `medium`, or as many as a tolerance needs, by default the group's own."""
    theta, phase = medium["theta"].data, medium["phase"].data
    if orders is not None and tolerance is not None:
        raise UsageError("moments: found orders beside a tolerance; give one of them")
    if orders is not None:
        if orders != int(orders) or not 0 <= orders <= _LARGEST:
            raise UsageError(f"moments: found orders {orders:g}; expected a whole number from 0 to {_LARGEST}")
        return Series(legendre_moments(theta, phase, int(orders)), series_error(theta, phase, int(orders)))
    aim = float(medium.attributes.get("tolerance", 0.01)) if tolerance is None else tolerance
    if not aim > 0:
        raise UsageError(f"moments: found a tolerance of {aim:g}; expected one above 0")
    return legendre_series(theta, phase, aim)


def expansion(medium: Group, orders=None, tolerance=None) -> Expansion:
    """Expansion coefficients of a group `medium`; UsageError where it lacks an element of the matrix."""
    missing = [name for name in ELEMENTS if name not in medium.members]
    if missing:
        raise UsageError("medium: an expansion in generalised spherical functions needs the matrix elements "
                         + ", ".join(missing) + ", which the asset lacks; particles with phase: {polarized: true} would do")
    last = moments(medium, orders, tolerance).moments.shape[-1] - 1
    return expansion_coefficients(medium["theta"].data, medium["phase"].data, *(medium[name].data for name in ELEMENTS), last)


def error_of(medium: Group) -> np.ndarray:
    """(L,) largest error of a moment: the integral of the phase function's error over the sphere, since no |P_l| exceeds 1."""
    theta, phase = medium["theta"].data, medium["phase"].data
    stated = stated_error(medium, "phase")
    return phase_integral(theta, float(medium.attributes.get("achieved_error", 0.0)) * phase if stated is None else stated)


def answered(asset, path: str, arguments: Mapping) -> Answer:
    """What `bake query ASSET medium/moments` and `medium/alpha1` print."""
    lists_of(path, arguments, _ARGUMENTS)
    if "medium" not in asset.tree.members:
        raise UsageError(f"{path}: the asset holds no medium; a recipe with particles, medium or grains would do")
    medium, name = asset.tree["medium"], path.rpartition("/")[2]
    series = moments(medium, **arguments)
    last = series.moments.shape[-1] - 1
    values = series.moments if name == "moments" else getattr(expansion(medium, last), name)
    scale = np.ones(last + 1) if name == "moments" else 2 * np.arange(last + 1) + 1
    told = (f"orders 0 to {last}; the phase function less its series is {float(series.cut.max()):.2g} of the light "
            "(the integral over the sphere)")
    if "orders" not in arguments and last == MOST:
        told += f"; more than {MOST} orders only where they are asked for"
    axes = (("wavelength", "um", asset.wavelength), ("order", "1", np.arange(last + 1)))
    return Answer(path, "1", values, axes, error_of(medium)[:, None] * scale, (Remark(told),))


_ARGUMENTS = {"orders": NUMBER_ONLY, "tolerance": FRACTION}
QUERIES = tuple(Query(f"medium/{name}", _ARGUMENTS, "orders=64, or tolerance=1%", answered, bare=True)
                for name in ("moments", *COEFFICIENTS))
