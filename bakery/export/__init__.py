"""Hands assets to other software, and says what was lost on the way.

`tabphase` resamples a phase function to a regular grid, `mitsuba` writes a scene fragment with it, `csv` writes tables.
"""
