"""Separate particles: one realisation of the medium."""
