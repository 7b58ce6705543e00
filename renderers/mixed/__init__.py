"""Several materials in one scene: particles around grains around bodies, in media."""
