"""Continuous media."""
