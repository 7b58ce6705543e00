"""Light of the third and later scattering events from a point and from a segment source in an infinite homogeneous medium."""
