"""Geometrical optics under its public name; the work is done in `bakery.physics.goa`."""

from bakery.physics.goa import *  # noqa: F403
