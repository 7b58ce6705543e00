"""Packed grains: random walks through a tile, and the continuous medium that stands for them."""
