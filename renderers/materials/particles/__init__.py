"""Separate particles: fog whose droplets can be seen, glitter, dust in a beam of light."""
