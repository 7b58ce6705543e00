"""Exemplar grains in the studio: real meshes and balls with their surfaces and interiors, standing on the ground.

The studio's unit is here as many bounding radii as `scale` says, so that all grains are seen.
"""

import math
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bakery.store import ply
from renderers.preview import studio

MOST = 6  # grains in a picture: the commonest
# Places in bounding radii, to the right and towards the camera, and how many radii wide what the studio's block is must be.
_PLACES = {
    1: (((0.0, 0.0),), 1.85),
    2: (((-1.08, 0.0), (1.08, 0.0)), 2.6),
    3: (((-1.12, 0.75), (1.12, 0.75), (0.0, -1.15)), 2.9),
    4: (((-1.15, 1.1), (1.15, 1.1), (-1.15, -1.3), (1.15, -1.3)), 3.3),
    5: (((-1.9, 1.0), (0.3, 1.35), (2.3, 0.8), (-0.9, -1.1), (1.4, -1.3)), 4.1),
    6: (((-2.2, 1.0), (0.0, 1.4), (2.2, 1.0), (-2.2, -1.2), (0.0, -0.8), (2.2, -1.2)), 4.3),
}
_AIM = 0.47  # of the tallest grain's height, where the camera looks
_TURN = 25.0  # degrees about the vertical: no face looks straight at the camera
# Meetings with the surface after which a path may be ended by chance, and is ended.
ROULETTE, DEPTH = 16, 400


@dataclass(frozen=True)
class Grain:
    """One component as it is drawn.

    name, share : of the component; share of the number of grains
    vertices, faces : (V, 3) in bounding radii as the grain lies, its foot at z = 0, (F, 3); None for a ball
    surface : as stored: `type` with `index`, `reflectance` or `n` and `k`, one a wavelength, and `roughness`
    interior : (L,) 1/m
    """

    name: str
    share: float
    vertices: np.ndarray | None
    faces: np.ndarray | None
    surface: dict
    interior: np.ndarray

    @property
    def height(self) -> float:
        """Bounding radii."""
        return 2.0 if self.vertices is None else float(self.vertices[:, 2].max())


def grains_of(asset) -> tuple[list[Grain], float, int]:
    """The grains to draw, commonest first; the bounding radius in m (mean by number); the number of components."""
    group = asset.grains
    exemplars = []
    for name, exemplar in group.exemplars.items():
        vertices, faces = (None, None) if exemplar.ball else (resting(exemplar.vertices), exemplar.faces)
        exemplars.append(Grain(name, float(group[name].weight), vertices, faces, exemplar.surface,
                               np.asarray(group[name].interior)))
    radius, share = (np.ravel(np.asarray(group[key], float)) for key in ("radius", "radius_share"))
    exemplars.sort(key=lambda grain: -grain.share)
    return exemplars[:MOST], float(np.sum(radius * share) / np.sum(share)), len(exemplars)


def scale(count: int) -> float:
    """Bounding radii in the studio's unit, for a number of grains."""
    return _PLACES[count][1]


def scene(mi, grains: list[Grain], radius: float, k: int, width: int, height: int):
    """The studio with grains at wavelength k; `radius` in m."""
    shown, unit = {}, scale(len(grains))
    places = _PLACES[len(grains)][0]
    with tempfile.TemporaryDirectory() as folder:
        for i, (grain, position) in enumerate(zip(grains, places)):
            shown[f"grain{i}"] = _shape(grain, position, unit, radius, k, Path(folder))
        return studio.furnished(mi, shown, width, height, {"type": "volpath", "max_depth": DEPTH, "rr_depth": ROULETTE},
                                 (0.0, 0.0, _AIM * max(grain.height for grain in grains) / unit))


def features(mi, grains: list[Grain], radius: float, width: int, height: int):
    """What the camera sees of grains and ground, nearly without noise: (height, width, 4) normal of the grains, and the ground.

    Edges that the filter of the picture keeps; what is seen through a grain is none of them.
    """
    built = scene(mi, [Grain(g.name, g.share, g.vertices, g.faces, {"type": "diffuse", "reflectance": [0.5]}, np.zeros(1))
                       for g in grains], radius, 0, width, height)
    integrator = mi.load_dict({"type": "aov", "aovs": "n:sh_normal,p:position"})
    image = np.array(mi.render(built, integrator=integrator, spp=64, seed=1), dtype=float)
    normal, position = image[..., -6:-3], image[..., -3:]
    on_ground = np.clip(normal[..., 2:3], 0, 1) * (position[..., 2:3] < 1e-3)
    ground = studio.reflectance(position[..., 0], position[..., 1])[..., None] * on_ground
    return np.concatenate([0.5 * np.where(on_ground > 0.99, 0.0, normal), ground], axis=-1)


def bsdf(surface: dict, k: int) -> dict:
    """A stored surface at wavelength k as a dictionary for Mitsuba; the angles' distribution is the scatterometer's, GGX."""
    kind, alpha = surface["type"], float(surface.get("roughness", 0.0))
    rough = {"distribution": "ggx", "alpha": alpha} if alpha > 0 else {}
    prefix = "rough" if rough else ""
    if kind == "diffuse":
        return {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": float(surface["reflectance"][k])}}
    if kind == "conductor":
        n, absorbs = float(surface["n"][k]), float(surface["k"][k])
        optics = {"eta": n, "k": absorbs} if math.isfinite(n) and math.isfinite(absorbs) else {"material": "none"}
        return {"type": f"{prefix}conductor", **rough, **optics}
    index = float(surface["index"][k])
    if abs(index - 1) < 1e-6:
        return {"type": "null"}
    return {"type": f"{prefix}dielectric", **rough, "int_ior": index, "ext_ior": 1.0}


def resting(vertices):
    """(V, 3) vertices turned so that the grain lies stable: its centre as low as it gets; foot at z = 0, still unscaled."""
    from scipy.spatial import ConvexHull, QhullError
    from scipy.spatial.transform import Rotation

    try:
        plane = ConvexHull(vertices).equations
    except QhullError:
        return vertices - [0, 0, vertices[:, 2].min()]
    down = plane[np.argmin(-plane[:, 3] - plane[:, :3] @ vertices.mean(axis=0)), :3]
    turned = vertices @ Rotation.align_vectors([0.0, 0.0, -1.0], down)[0].as_matrix().T
    return turned - [0, 0, turned[:, 2].min()]


def _shape(grain: Grain, position, unit: float, radius: float, k: int, folder: Path) -> dict:
    """A grain's shape for Mitsuba, its radius 1 / unit; absorption per unit of the studio."""
    right = np.cross(studio.TARGET - studio.CAMERA, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    towards = np.cross([0.0, 0.0, 1.0], right) * -1.0
    foot = (position[0] * right + position[1] * towards) / unit
    common = {"bsdf": bsdf(grain.surface, k)}
    sigma = grain.interior[k] * radius * unit if grain.surface["type"] == "dielectric" else 0.0
    if sigma > 0:
        common["interior"] = {"type": "homogeneous", "sigma_t": float(sigma), "albedo": 0.0, "sample_emitters": False}
    if grain.vertices is None:
        return {"type": "sphere", "center": [*foot[:2], 1 / unit + studio.LIFT], "radius": 1 / unit, **common}
    vertices = grain.vertices
    middle = 0.5 * (vertices[:, :2].min(axis=0) + vertices[:, :2].max(axis=0))
    turn = np.radians(_TURN)
    flat = (vertices[:, :2] - middle) @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    path = folder / f"{len(list(folder.iterdir()))}.ply"
    # a file: the one way to hand a mesh to every version of Mitsuba
    path.write_bytes(ply.mesh(np.column_stack([flat / unit + foot[:2], vertices[:, 2] / unit + studio.LIFT]), grain.faces,
                              single=True))
    return {"type": "ply", "filename": str(path), "face_normals": True, **common}
