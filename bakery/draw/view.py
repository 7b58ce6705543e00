"""What ray-cast pictures share: where the viewer stands, and how light becomes the numbers of a picture."""

from __future__ import annotations

import numpy as np


def looking_from(direction) -> np.ndarray:
    """Rotation whose rows are right, up and towards the viewer, for a viewer in a direction; z (or y) is up."""
    back = direction / np.linalg.norm(direction)
    up = np.array([0.0, 0.0, 1.0]) if abs(back[2]) < 0.99 else np.array([0.0, 1.0, 0.0])
    right = np.cross(up, back)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(back, right), back])


def srgb(linear):
    """Linear light, 0 to 1, as sRGB encodes it."""
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-12) ** (1 / 2.4) - 0.055)
