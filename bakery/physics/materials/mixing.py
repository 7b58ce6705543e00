"""Internally mixed materials: one index for a fine mixture of several, by shares of the volume.

Sources: Bruggeman, Ann. Phys. 24, 636 (1935); Maxwell Garnett, Phil. Trans. R. Soc. A 203, 385 (1904); Bohren & Huffman 1983,
section 8.5; volume mean: Hess, Koepke & Schult, Bull. Am. Meteorol. Soc. 79, 831 (1998).
"""

import numpy as np

RULES = ("bruggeman", "maxwell_garnett", "lorentz_lorenz", "volume")
_STEPS, _RESIDUAL = 400, 1e-12


def mixed(rule: str, index, share, matrix=None):
    """Index of a mixture.

    rule : `bruggeman` (all alike), `maxwell_garnett` (inclusions in a matrix, which has the rest of the volume), `lorentz_lorenz`
        (molar refractions add up) or `volume` (n and k add up)
    index : (K, L) complex, n + ik with k >= 0, relative to vacuum
    share : (K,) of the volume, adding up to 1; with a matrix to less than 1
    matrix : (L,) complex, of `maxwell_garnett` only

    Returns index : (L,) complex
    Raises ValueError : a mixture that the rule knows nothing of

    Rules of effective media hold for pieces that are much smaller than the wavelength in them.

    >>> mixed("volume", [[1.5], [1.3]], [0.25, 0.75])
    array([1.35+0.j])
    """
    index, share = np.asarray(index, complex), np.asarray(share, float)[:, None]
    if rule == "volume":
        return np.sum(share * index, axis=0)
    square = index**2
    if rule == "lorentz_lorenz":
        return _of_polarisation(np.sum(share * (square - 1) / (square + 2), axis=0), 1.0)
    if rule == "maxwell_garnett":
        host = np.asarray(matrix, complex) ** 2
        return _of_polarisation(np.sum(share * (square - host) / (square + 2 * host), axis=0), host)
    if rule != "bruggeman":
        raise ValueError(f"rule {rule!r}; {', '.join(RULES)} would do")
    return _root(_bruggeman(square, share))


def _of_polarisation(p, host):
    """Index at which (e - host)/(e + 2 host) is p."""
    if (np.abs(1 - p) < 1e-9).any():
        raise ValueError("the pieces resonate, and their mixture has no index; another rule or other shares would do")
    return _root(host * (1 + 2 * p) / (1 - p))


def _bruggeman(e, share):
    """Root of sum share (e_k - e)/(e_k + 2 e) = 0 in the upper half plane, from the volume mean; of two by the closed form."""
    if len(e) == 2:
        b = (3 * share[0] - 1) * e[0] + (3 * share[1] - 1) * e[1]
        root = np.sqrt(b * b + 8 * e[0] * e[1])
        roots = np.stack([(b + root) / 4, (b - root) / 4])
        # passive: Im >= 0; of two real roots the positive one
        better = np.where(np.abs(roots.imag) > 1e-14 * np.abs(roots), roots.imag, roots.real * 1e-14)
        return np.take_along_axis(roots, np.argmax(better, axis=0)[None], axis=0)[0]
    mean = np.sum(share * e, axis=0)
    for _ in range(_STEPS):
        weight = share / (e + 2 * mean)
        mean = np.sum(weight * e, axis=0) / np.sum(weight, axis=0)
    residual = np.abs(np.sum(share * (e - mean) / (e + 2 * mean), axis=0))
    if not (residual < _RESIDUAL).all():
        raise ValueError("the equation of Bruggeman is not solved for these materials; another rule would do")
    return mean


def _root(e):
    """n + ik with n >= 0 and k >= 0."""
    index = np.sqrt(np.asarray(e, complex))
    return np.where(index.real < 0, -index, index)
