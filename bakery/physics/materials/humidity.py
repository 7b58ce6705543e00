"""How particles grow with the humidity of air.

Source: Petters & Kreidenweis, Atmos. Chem. Phys. 7, 1961 (2007), eq. 6, without the effect of curvature (Kelvin).
"""

import numpy as np


def growth_factor(kappa: float, humidity: float) -> float:
    """Radius at a relative humidity (0 to below 1) over the dry one, by kappa-Koehler theory without curvature.

    The volume of water over that of the dry particle is kappa a/(1 - a), where the activity a is the humidity.

    >>> round(growth_factor(0.61, 0.9), 4)  # ammonium sulphate
    1.8653
    """
    return (1 + kappa * humidity / (1 - humidity)) ** (1 / 3)


def tabulated(humidity, factor, wanted: float) -> float:
    """Growth factor at a relative humidity, from a table.

    Between the rows kappa, (g^3 - 1)(1 - h)/h, is linear in h: the factor rises towards 1 as particles do.  Below the first row
    above 0 it has the kappa of that row; at 0 the factor is 1.

    humidity : (T,) 1, ascending, 0 to below 1
    factor : (T,) radius over the dry radius

    Raises ValueError : above the table
    """
    h, g = np.asarray(humidity, float), np.asarray(factor, float)
    if wanted > h[-1]:
        raise ValueError(f"humidity {wanted:g} is above the table; 0 to {h[-1]:g} would do")
    if wanted == 0:
        return 1.0
    if wanted in h:
        return float(g[h == wanted][0])
    wet = h > 0
    kappa = (g[wet] ** 3 - 1) * (1 - h[wet]) / h[wet]
    return growth_factor(float(np.interp(wanted, h[wet], kappa)), wanted)
