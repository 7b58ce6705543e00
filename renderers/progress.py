"""Progress: a function of (fraction 0 to 1, noise so far or None), or None where nobody asks."""


def share(progress, begin, end):
    """The progress of a part that takes the whole from `begin` to `end`."""
    return progress and (lambda fraction, noise=None: progress(begin + fraction * (end - begin), noise))
