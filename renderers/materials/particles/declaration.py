"""What a method of the renderer of particles declares."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from renderers.scene.declaration import SceneMethod


class Passes(NamedTuple):
    """What makes the picture.

    passes : `renderers.pictures.engine.Part`, or its name, its function, and what that takes of the method
    depth : (H, W) m, up to which particles are seen one by one; None where it has no meaning
    reasons : sentences
    """

    passes: list[Any]
    depth: np.ndarray | None = None
    reasons: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class ParticleMethod(SceneMethod):
    """A method of particles.

    passes : (`methods.Setup`, tolerance, seed) -> Passes
    peak : whether a forward peak may count as unscattered
    """

    kind: str = "particles"
    passes: Callable[..., Passes]
    peak: bool = True
