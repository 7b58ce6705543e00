"""What a method of the renderer of grains declares."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from renderers.scene.declaration import SceneMethod


def explicit(*grains) -> Any:
    """Paths from grain to grain; parameters as those of `paths.Explicit`."""
    from renderers.materials.grains import paths

    return paths.Explicit(*grains)


@dataclass(frozen=True, kw_only=True)
class GrainMethod(SceneMethod):
    """A method of grains.  Its `error`, where nothing measures it, is the largest of eight scenes against ept (docs/granular.md).

    grains : what makes the interactor of a body's grains, of grains, occupied voxels and colours
    medium : whether light goes on in the medium that stands for the grains; where it is `continuous` it begins there
    diffuses : whether it diffuses far inside of the medium
    widens : whether smooth grains show small lamps wider than they are, by `regularised`
    """

    kind: str = "grains"
    grains: Callable[..., Any] = explicit
    medium: bool = False
    diffuses: bool = False
    widens: bool = False

    @property
    def switches(self) -> bool:
        """Whether paths go from grains to the medium."""
        return self.medium and not self.continuous
