"""Lorenz-Mie theory under its public name; the work is done in `bakery.physics.mie`."""

from bakery.physics.mie import *  # noqa: F403
