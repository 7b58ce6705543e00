"""Spread of a narrow beam by scattering: moments, closed forms, the exact small-angle kernel, transport, photon counting.

Lengths are mean free paths.  A beam of power 1 enters the medium at depth 0 along +z; a kernel is the scattered light at depth z
and distance r from the axis, integrated over directions (fluence), or counted through a plane (flux), in mfp^-2.
"""
