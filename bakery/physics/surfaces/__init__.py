"""Light that plane layers of a medium send back and let through: discrete ordinates, one Fourier order in azimuth at a time."""
