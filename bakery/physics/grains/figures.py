"""Figures with standard errors: what is measured of grains."""

from __future__ import annotations


class WithErrors:
    """A result whose standard error of figure X, `errors["X"]`, is read as X_error."""

    errors: dict

    def __getattr__(self, name):
        figure = name.removesuffix("_error")
        if figure != name and figure in self.__dict__.get("errors", ()):
            return self.errors[figure]
        raise AttributeError(name)
