"""Figures with standard errors: what is measured of grains."""

import numpy as np


class WithErrors:
    """A result whose standard error of figure X, `errors["X"]`, is read as X_error."""

    errors: dict

    def __getattr__(self, name):
        figure = name.removesuffix("_error")
        if figure != name and figure in self.__dict__.get("errors", ()):
            return self.errors[figure]
        raise AttributeError(name)


def in_order(parts):
    """Sums (R, ...) over the parts (R, P, ...), one after the other: in no order that NumPy chooses."""
    total = np.zeros_like(parts[:, 0])
    for part in range(parts.shape[1]):
        total += parts[:, part]
    return total
