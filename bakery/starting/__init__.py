"""Scenes to start from: somebody's mesh in a studio, fog in somebody's Mitsuba scene, and the scenes that ship.

Each function returns the files to write, path -> content; `bakery.store.put.put_all` writes all of them or none.
"""
