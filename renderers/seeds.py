"""Seeds of pictures, as programs give them."""

import operator

from bakery.errors import UsageError

_END = 1 << 64  # of `bakery.rng`


def checked(seed) -> int:
    """A seed, 0 for None.  Raises UsageError where it is no whole number from 0 to 2^64 - 1."""
    if seed is None:
        return 0
    try:
        number = operator.index(seed)
    except TypeError:
        number = -1
    if not 0 <= number < _END:
        raise UsageError(f"seed: found {seed!r}; expected a whole number from 0 to 2^64 - 1")
    return number
