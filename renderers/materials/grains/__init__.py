"""Granular materials: sand, salt, sugar, beads, each grain to be seen."""
