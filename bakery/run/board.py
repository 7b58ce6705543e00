"""One display over several recipes that are baked: what is done, what goes on, what failed, the time that is left."""

from collections.abc import Sequence

from bakery.plan import RUN
from bakery.run.progress import Progress

EACH = 0.06  # seconds that a recipe takes besides its stages: cache, file, checks
SHOWN = 4  # recipes that go on and are named at once
_ONCE = "cache: ", "cluster: "  # remarks that are not about a recipe: said once, whichever meets it


class Board:
    """Shows several bakes on the display of one."""

    def __init__(self, progress: Progress, names: Sequence[str], plans: Sequence, workers: int):
        self._progress, self._names = progress, names
        self._weights = [EACH + plan.seconds * plan.write for plan in plans]
        self._shares = [_shares(plan) for plan in plans]
        self._running: dict[int, _Part] = {}
        self._done, self._failed, self._ended, self._said = 0, 0, 0.0, set()
        progress.stage(f"{len(names)} recipes", "", 0.0, sum(self._weights) / workers)

    def part(self, index: int) -> Progress:
        """The progress of one recipe, which begins."""
        self._running[index] = _Part(self, index, self._shares[index])
        return self._running[index]

    def ended(self, index: int, failed: bool) -> None:
        """A recipe is done, or has failed."""
        self._running.pop(index, None)
        self._done, self._failed = self._done + (not failed), self._failed + failed
        self._ended += self._weights[index]
        self.show()

    def say(self, index: int, text: str) -> None:
        """A remark of a recipe."""
        if not text.startswith(_ONCE):
            self._progress.say(f"{self._names[index]}: {text}")
        elif text not in self._said:
            self._said.add(text)
            self._progress.say(text)

    def show(self) -> None:
        """Draw anew."""
        running = list(self._running.items())
        done = self._ended + sum(self._weights[index] * part.share for index, part in running)
        words = [f"{self._done} done"] + [f"{self._failed} failed"] * bool(self._failed)
        words += [f"{self._names[index]} {part.words}".rstrip() for index, part in running[:SHOWN]]
        words += [f"and {len(running) - SHOWN} more"] * (len(running) > SHOWN)
        self._progress.update(done / sum(self._weights), None, ", ".join(words))


class _Part(Progress):
    """One recipe on a board."""

    def __init__(self, board: Board, index: int, shares: dict[str, tuple[float, float]]):
        self._board, self._index, self._shares = board, index, shares
        self._before, self._of = 0.0, 1.0  # share done before this stage, share of this stage
        self.share, self.words = 0.0, ""

    def stage(self, name, title, tolerance, seconds):
        self._before, self._of = self._shares.get(name, (0.0, 1.0))
        self.share, self.words = self._before, name
        self._board.show()

    def update(self, fraction, error=None, state=""):
        self.share = self._before + self._of * fraction
        self._board.show()

    def done(self, name, text):
        self.update(1.0)
        self.words = ""
        self.say(f"{name}: {text}")

    def say(self, text):
        self._board.say(self._index, text)


def _shares(plan) -> dict[str, tuple[float, float]]:
    """Of each stage the share of the plan's time before it, and its own; a family shows its places as one stage."""
    steps = [step for step in getattr(plan, "steps", ()) if step.action == RUN]
    total = sum(step.cost.seconds for step in steps) or 1.0
    shares, before = {}, 0.0
    for step in steps:
        shares[step.stage.name] = before / total, step.cost.seconds / total
        before += step.cost.seconds
    return shares
