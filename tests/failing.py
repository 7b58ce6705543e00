"""Points of a family that cannot be baked."""

from collections.abc import Callable

from bakery.physics.medium import analytic


def fails_at(monkeypatch, g: float | None, error: Exception) -> Callable[[], None]:
    """Analytic phase functions of a parameter `g`, None: of any, raise an error, until what is returned is called."""
    def tabulated(kind, tolerance, wavelengths, parameter, *rest):
        if g is None or parameter[0] == g:
            raise error
        return original(kind, tolerance, wavelengths, parameter, *rest)

    original = analytic.tabulated
    monkeypatch.setattr(analytic, "tabulated", tabulated)
    return lambda: monkeypatch.setattr(analytic, "tabulated", original)
