"""The continuous medium that stands for packed grains."""
