"""Loops of Markov chains over paths: what each of them brings to the picture."""

from bakery.system.compiled import njit


@njit(cache=True, nogil=True, error_model="numpy")
def bring(light, pixel, share, by_order):
    """Adds shares (n,) of light (n, 3 orders) to pixels (n,) of by_order (orders, pixels, 3), one path after the other."""
    for i in range(len(pixel)):
        if share[i] > 0.0:
            for order in range(len(by_order)):
                for c in range(3):
                    by_order[order, pixel[i], c] += share[i] * light[i, 3 * order + c]
