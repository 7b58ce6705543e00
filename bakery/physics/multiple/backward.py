"""What is refused as a narrow backward peak, whose light cannot count as unscattered as that of a forward peak can.

Loads nothing heavy: plans ask as well.
"""

import numpy as np

WHOLE, KEPT = 96, 40  # orders that are solved in full at most; those that are kept where a phase function has more
SHARE = 0.05  # of the light in an unresolved backward peak that is refused


def refused(g, orders: int | None = None):
    """Whether the solver refuses lobes of Henyey and Greenstein with mean cosines g, so that photons stand in; of its shape.

    orders : Legendre orders that are asked for, or None

    Moments are g^l; `legendre.refuse_backward` takes those of three orders beyond the kept ones for the light in the peak.
    """
    return -np.sign(g) * np.abs(g) ** ((orders or KEPT) + 2.0) > SHARE
