"""The pinhole camera of all renderers of scenes: where it stands, and the ray through each pixel."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole camera: `origin` (3,) m, and its image plane at unit distance along its axis.

    The middle of the pixel in row y, column x is `corner` + (x + 1/2) `right` + (y + 1/2) `down`, (3,) each, from the origin.
    """

    origin: np.ndarray
    corner: np.ndarray
    right: np.ndarray
    down: np.ndarray

    @classmethod
    def looking(cls, origin, target, up, fov, height, width):
        """From `origin` (m) at `target` in the middle; `fov` rad from the left to the right edge."""
        origin, ahead = np.array(origin, float), np.subtract(target, origin)
        ahead = ahead / np.linalg.norm(ahead)
        right = np.cross(ahead, up)
        right = right / np.linalg.norm(right)
        pitch = 2 * np.tan(fov / 2) / width
        right, down = right * pitch, np.cross(ahead, right) * pitch
        return cls(origin, ahead - right * width / 2 - down * height / 2, right, down)

    def refitted(self, height, width, new_height, new_width):
        """The same view on a film of another size: middle, width of the picture and shape of the pixels stay."""
        middle = self.corner + self.right * width / 2 + self.down * height / 2
        right, down = self.right * width / new_width, self.down * width / new_width
        return Camera(self.origin, middle - right * new_width / 2 - down * new_height / 2, right, down)

    @property
    def pixel(self) -> float:
        """Angle of a pixel in the middle of the picture, rad: the root of that of its sides."""
        return float(np.sqrt(np.linalg.norm(self.right) * np.linalg.norm(self.down)))

    def points(self, height, width):
        """Middles of the pixels on the image plane, (H, W, 3), from the origin."""
        y, x = np.mgrid[:height, :width] + 0.5
        return self.corner + x[..., None] * self.right + y[..., None] * self.down

    def rays(self, height, width):
        """Directions through the middles of the pixels, (H, W, 3), unit."""
        points = self.points(height, width)
        return points / length(points)[..., None]

    def rays_at(self, offset, corner):
        """Rays through pixels whose upper left corners are (n, 2) x and y, at an offset (n, 2) in each: origins (n, 3) m, and
        directions (n, 3)."""
        x, y = (corner + offset).T
        points = self.corner + x[:, None] * self.right + y[:, None] * self.down
        return np.tile(self.origin, (len(points), 1)), points / length(points)[:, None]

    def angle(self, height, width):
        """Side of a pixel as seen from the camera, (H, W) rad: the root of its solid angle.

        With square pixels of pitch p that is p cos^1.5 of the angle to the axis: the geometric mean of p cos^2 outwards and
        p cos across.
        """
        return np.sqrt(np.linalg.norm(np.cross(self.right, self.down)) / length(self.points(height, width)) ** 3)


def length(points):
    """Lengths (...) of vectors (..., 3)."""
    # no BLAS and no pairwise sums: the same bits on every machine
    return np.sqrt(points[..., 0] ** 2 + points[..., 1] ** 2 + points[..., 2] ** 2)
