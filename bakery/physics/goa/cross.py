"""Cross sections of large spheres in closed form: extinction from the forward rays, absorption from all rays summed."""

import numpy as np

from bakery.physics.goa import _inputs

EDGE = 1.99226  # first edge term of the extinction efficiency, times x^(-2/3): Nussenzveig & Wiscombe 1980
NODES = 256


def extinction_of_rays(m, x):
    """Extinction efficiency: diffraction, the axial ray p = 1 and the edge.

    Parameters, errors as `bakery.goa.amplitudes`.

    Returns q_ext : of the broadcast shape; 1

    2 - (8/x) Im[m^2 exp(2ix(m-1))/((m+1)^2 (m-1))] + 1.99226 x^(-2/3), for n above and below 1; where x |m - 1| < 1 the axial ray
    diverges and anomalous diffraction, 4 Re[1/2 + e^-w/w + (e^-w - 1)/w^2] with w = -2ix(m-1), stands in (van de Hulst 1957,
    ch. 11).  For absorbing spheres the edge term is that of transparent ones.
    """
    shape, m, x = _inputs.large(m, x)
    q = np.empty(x.size)
    mirror = np.isinf(m)
    soft = ~mirror & (abs(m - 1.0) * x < 1.0)
    refracted = ~mirror & ~soft
    q[mirror] = 2.0
    z, y = m[refracted], x[refracted]
    q[refracted] = 2.0 - 8.0 / y * np.imag(z * z * np.exp(2j * y * (z - 1.0)) / ((z + 1.0) ** 2 * (z - 1.0)))
    q[~soft] += EDGE * x[~soft] ** (-2.0 / 3.0)
    w = -2j * x[soft] * (m[soft] - 1.0)
    series = np.zeros(w.shape, dtype=np.complex128)  # sum_{j>=1} (-1)^(j+1) (j+1) w^j/(j+2)!, as |w| < 2
    term = np.full(w.shape, 0.5 + 0j)
    for j in range(1, 30):
        term = term * -w / (j + 2.0)
        series -= (j + 1.0) * term
    q[soft] = np.maximum(4.0 * series.real, 0.0)
    return q.reshape(shape)[()] if shape else float(q[0])


def absorption(m, x):
    """Absorption efficiency of large spheres: all rays of all orders, summed without their phases.

    Parameters, errors as `bakery.goa.amplitudes`.

    Returns
    -------
    q_abs : of the broadcast shape; 1

    Notes
    -----
    Half the sum over both polarisations of int (1-R)(1-e^-t)/(1-R e^-t) d(sin^2 t_i), R = |r|^2 with the complex index,
    t = 4 x k cos t_t; beyond the critical angle of bubbles 1 - R alone.  Exact to 1 % for x > 1000, 6 % low at 100 (12 % where
    4xk << 1): tunnelling at the edge is missing, of order x^(-2/3).
    """
    from bakery.physics.goa import _cross

    shape, m, x = _inputs.large(m, x)
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    q = np.empty(x.size)
    _cross.absorption_block(m, x, nodes, weights, q)
    return q.reshape(shape)[()] if shape else float(q[0])
