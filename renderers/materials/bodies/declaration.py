"""What a method of the renderer of translucent bodies declares."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from renderers.scene.declaration import SceneMethod

# kinds of passes: paths from the eye, beams that lines of sight gather, dipoles of their ends, beams that are joined where they
# pass close by, chains among beams and lines of sight; of a method of several kinds the first are `FEW`, paths of few events
FEW, GATHERED, DIFFUSED, JOINED, MUTATED = "few", "beams", "dipoles", "joined", "mutations"

# Beams of a pass to a square transport mean free path of the boundary, below which a method by beams is refused: hardly a line
# of sight has a beam near it in a thousand passes, so pictures are dark with a few fireflies, and their noise is not known.
# Balls of 300, 1000 and 10,000 mean free paths (0.007, 7e-4, 7e-6), three and more events over those of shells: vrl+tables 1.05
# (0.02), 1.03 (0.08), 0.5 (1.5); beams 1.1 (0.2), 0.6 (0.4), 1e-4
FEWEST_GATHERED, FEWEST_MET = 1e-4, 1e-3


def of_points_behind_glass(world, body) -> bool:
    """Paths find lights in second events, but for lights that no ray can meet, through boundaries that turn light."""
    return world.without_extent and not body.matched


def of_picture(means, rgb, missing) -> float | None:
    """What sharing between pixels and spreading of beams change; parameters as those of `bias.of_picture`."""
    from renderers.materials.bodies import bias

    return bias.of_picture(means, rgb, missing)


def unfit(scene, number, asset, world) -> str:
    """Of what fills a shape: that is no closed mesh, or lets no light in."""
    from renderers.materials.bodies import bodies

    entry = scene.values.materials[number]
    return bodies.refusal(world.shapes(), entry.where.shape, entry.index)


@dataclass(frozen=True, kw_only=True)
class BodyMethod(SceneMethod):
    """A method of translucent bodies.

    Attributes
    ----------
    reads_tables : whether it looks up the tables of multiple scattering, if only how light decays with distance
    tabled : whether later events are from the tables
    parts : kinds of its passes; () where it follows all events from the eye
    metropolis : whether it does so by chains of paths (`renderers.transport.metropolis`), which nothing else follows
    spheres : whether light jumps through empty spheres
    second : (world, body) -> whether second events are gathered from beams, not sampled
    beams_of_events : whether light behind smooth boundaries is gathered from the beams that begin at its first events, too
    blurred : whether light that scatters in a body is blurred where boundaries turn it, and where they do not
    fewest_beams : as `FEWEST_GATHERED`; 0 where it needs none
    """

    kind: str = "body"
    measured: Callable[..., Any] | None = of_picture
    unfit: Callable[..., str] = unfit
    reads_tables: bool = False
    tabled: bool = False
    parts: tuple[str, ...] = ()
    metropolis: bool = False
    spheres: bool = False
    second: Callable[[Any, Any], bool] = of_points_behind_glass
    beams_of_events: bool = False
    blurred: tuple[bool, bool] = (False, False)
    fewest_beams: float = 0.0

    @property
    def joined(self) -> bool:
        """Whether beams are joined with lines of sight where they pass close by."""
        return JOINED in self.parts

    @property
    def diffused(self) -> bool:
        """Whether later events are dipoles."""
        return DIFFUSED in self.parts
