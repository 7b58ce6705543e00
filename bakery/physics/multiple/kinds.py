"""Kinds of sources: their numbers, in tables and kernels, and their names, in recipes and assets."""

KINDS = ("point", "segment")
POINT, SEGMENT = range(len(KINDS))
