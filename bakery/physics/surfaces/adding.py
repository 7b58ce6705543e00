"""Layers of a stack one on the other, from the bottom up, of one Fourier order: what is only mirrored, and what is scattered.

In radiance over n^2 the operators of `layer` are the same on both sides of a smooth boundary, and symmetric for any stack: each
order is what is only mirrored, D, a number a node, and what is scattered, S.  Neither is a difference of larger numbers.  Facets
(`rough`) scatter all that they send on: above them there is no D.  Over air, what leaves below is kept in the same way, light
that passed unscattered apart; it is not symmetric: the other way is that of the stack upside down.
"""

import math
from collections.abc import Sequence

import numpy as np

from bakery.physics.surfaces import fresnel
from bakery.physics.surfaces.deep import Deep, layer_of_order
from bakery.physics.surfaces.layer import Layer
from bakery.physics.surfaces.orders import phase_matrices
from bakery.physics.surfaces.shared import Directions
from bakery.physics.surfaces.slab import Reflector, free


def of_order(nodes: Sequence[Directions], parts, cuts, missed, order: int, accuracy: float):
    """Of each layer, both parts of its phase function, and what it does."""
    phases, media = [], []
    for net, part, without, peak in zip(nodes, parts, cuts, missed, strict=True):
        mu, flux = net.mu(part.index), net.flux(part.index)
        depth = part.depth * without.shrinks if part.depth else 0.0
        phases.append(phase_matrices(without.moments, mu, order))
        media.append(layer_of_order(without, order, phases[-1], peak, (mu, flux), depth, accuracy))
    return phases, media


def below(nodes: Sequence[Directions], parts, media, under, order: int):
    """What is under the uppermost boundary, inside of it: D (N,) and S (N, N); and what of light from there leaves below.

    That is (N,) unscattered and (K, N) scattered, K directions in air; None where nothing does.

    under : what lies under all layers, and of each layer the facets on top
    """
    (bottom, facets), through = under, None
    if free(parts[0]):
        index, scattered = 1.0, np.zeros(2 * [int((nodes[-1].above == 1).sum())])
        through = np.ones(len(scattered)), scattered
    elif isinstance(bottom, Reflector):
        index, scattered = 1.0, bottom.matrix(nodes[-1].mu(1.0), nodes[-1].flux(1.0), order)
    else:
        index, root = parts[-1].index, np.sqrt(nodes[-1].flux(parts[-1].index))
        scattered = (bottom or 0.0) * np.outer(root, root) * (order == 0)
    mirrored = np.zeros(len(scattered))
    for k in range(len(parts))[::-1]:
        if k + 1 < len(parts) and facets[k + 1] is not None:
            scattered = facets[k + 1].over(scattered + np.diag(mirrored), order) + facets[k + 1].above[order]
            mirrored, index = np.zeros(len(scattered)), parts[k].index
        if parts[k].index != index:
            if through is not None:
                through = down(nodes[k], parts[k].index, index, mirrored, scattered, through)
            mirrored, scattered = _across(nodes[k], parts[k].index, index, mirrored, scattered)
            index = parts[k].index
        mirrored, scattered, through = _under_layer(media[k], mirrored, scattered, through, parts[k].depth == math.inf)
    return mirrored, scattered, through


def _under_layer(layer: Layer | Deep, mirrored, scattered, through, infinite: bool):
    """D, S and what leaves below of what is under a layer, seen from above it."""
    nothing = np.zeros(len(layer.direct))
    reflection, down = layer.scattered(nothing)
    if infinite:
        return nothing, reflection, None
    whole = scattered + np.diag(mirrored)
    if through is not None:
        passed, light = through
        arriving = np.linalg.solve(np.eye(len(nothing)) - reflection @ whole, down + reflection @ (whole * layer.direct))
        through = passed * layer.direct, light @ (arriving + np.diag(layer.direct)) + passed[:len(light), None] \
            * arriving[:len(light)]
    again = whole @ reflection @ np.linalg.solve(np.eye(len(nothing)) - whole @ reflection, whole)
    # all that comes up to the layer's lower face, and what of it is scattered
    returned, direct = whole + again, layer.direct
    returned_scattered = scattered + again
    scattered = reflection + down.T @ returned @ (down + np.diag(direct)) + direct[:, None] * (returned @ down) \
        + direct[:, None] * returned_scattered * direct
    return direct**2 * mirrored, scattered, through


def down(nodes: Directions, above: float, below: float, mirrored, scattered, through):
    """What of light from above a boundary leaves below; of what is under it D, S and the same."""
    mu, mu_below = nodes.mu(above), nodes.mu(below)
    shared, (passed, light) = min(len(mu), len(mu_below)), through
    boundary = np.ones(len(mu_below))
    boundary[:shared] = fresnel.between(above, mu[:shared], below, mu_below[:shared])
    enters = 1 - boundary[:shared]
    # between two boundaries that reflect totally nothing is lost, and nothing scattered gets there
    boundary = np.where(boundary * mirrored < 1, boundary, 0.0)
    again = 1 / (1 - boundary * mirrored)
    whole = scattered + np.diag(mirrored)
    arriving = np.linalg.solve(np.eye(len(whole)) - boundary[:, None] * whole, boundary[:, None] * scattered * again)
    direct, result = np.zeros(len(mu)), np.zeros((len(light), len(mu)))
    direct[:shared] = passed[:shared] * again[:shared] * enters
    whole = light @ (arriving + np.diag(again)) + passed[:len(light), None] * arriving[:len(light)]
    result[:, :shared] = whole[:, :shared] * enters
    return direct, result


def _across(nodes: Directions, above: float, below: float, mirrored, scattered):
    """D and S of what is under a boundary, seen from above it; indices of the media above and below."""
    mu, mu_below = nodes.mu(above), nodes.mu(below)
    shared = min(len(mu), len(mu_below))
    share = fresnel.between(above, mu[:shared], below, mu_below[:shared])
    inside, outside = np.ones(len(mu_below)), np.ones(len(mu))
    inside[:shared] = outside[:shared] = share
    through = 1 - share
    result = np.zeros((len(mu), len(mu)))
    result[:shared, :shared] = np.outer(through, through) * escaping(mirrored, scattered, inside)[:shared, :shared]
    outside[:shared] += through**2 * mirrored[:shared] / (1 - share * mirrored[:shared])
    return outside, result


def escaping(mirrored, scattered, boundary):
    """Scattered light that comes up to a boundary in all, of light that entered through it: what it sends back comes again.

    With W = D + S and the boundary's r that is W / (1 - r W) without D / (1 - r D), and no difference of the two.
    """
    # between two boundaries that reflect totally nothing is lost, and nothing scattered gets there
    boundary = np.where(boundary * mirrored < 1, boundary, 0.0)
    whole = scattered + np.diag(mirrored)
    result = np.linalg.solve((np.eye(len(whole)) - boundary[:, None] * whole).T, scattered.T).T
    return result / (1 - mirrored * boundary)[:, None]
