"""Hands assets to other software, and says what was lost on the way.

`mitsuba` writes a scene fragment with a phase function on a regular grid, `csv` writes tables, `hg` fits the lobes that renderers
without tables take.
"""
