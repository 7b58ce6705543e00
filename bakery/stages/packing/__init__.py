"""Periodic tiles of packed spheres."""
