"""The settings of one stage of one recipe: ladders of its knobs, presets, and the hash and expected time of each setting."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

from bakery.errors import BakeryError, RecipeError, StageError
from bakery.trade.resolve import above, find, hash_of, hashes_above
from bakery.trade.search import Ladder, Setting


@dataclass(frozen=True)
class Job:
    """What is to be measured."""

    recipe: Path  # path
    stage: str  # name
    base: Mapping[str, str]  # overrides in every setting
    presets: Mapping[str, Mapping[str, str]]  # name -> what it overrides beyond that, the cheapest first; it is the baseline
    folder: Path  # of the results
    stages: str = "bakery.stages:all_stages"  # `module:function` that returns all stages


class Settings:
    """The settings of a job.

    Attributes
    ----------
    recipe : as it stands
    stage : its declaration
    ladders : of the knobs that have values, as far as the recipe allows them
    refused : (overrides, message) of those that it does not
    """

    def __init__(self, job: Job):
        self.job = job
        self._recipes: dict = {}
        self._files: list[str] = []
        self._costs: dict[tuple, float] = {}
        self.recipe = self.load({})
        self.stage = find(job.stages, self.recipe, job.stage)
        self.refused: list[tuple[dict[str, str], str]] = []
        self.ladders = [self._ladder(knob) for knob in self.stage.knobs if knob.values]
        self._above: Mapping[str, str] = {}

    def load(self, overrides: Mapping[str, str]):
        """The recipe under overrides."""
        from bakery.recipe import load

        key = tuple(sorted(overrides.items()))
        if key not in self._recipes:
            self._recipes[key] = load(self.job.recipe, {**self.job.base, **overrides})
            self.refuse_changes()
        return self._recipes[key]

    def refuse_changes(self) -> None:
        """StageError if the recipe, or a file that it names, is no longer what it was: figures of two recipes must not mix."""
        paths = [self.job.recipe, *(file.path for file in next(iter(self._recipes.values())).files)]
        try:
            now = [sha256(Path(path).read_bytes()).hexdigest() for path in paths]
        except OSError:
            now = []
        if now != self._files and self._files:
            raise StageError(f"{self.job.recipe}: it, or a file that it names, changed while it was measured; start again")
        self._files = now

    def _ladder(self, knob) -> Ladder:
        current = self.recipe.leaves.get(knob.key, knob.default)
        rungs: list[tuple] = []  # value as the recipe holds it, text
        preset_values = [(preset.get(knob.key), self._effective(preset, knob.key)) for preset in self.job.presets.values()]
        for text in (*knob.values, *(written or text_of(value) for written, value in preset_values if value is not None)):
            try:
                value = self._value(knob.key, text)
            except RecipeError as error:
                why = error.problems[0]
                self.refused.append(({knob.key: text}, "; ".join(filter(None, (why.found, why.expected)))))
                continue
            _insert(rungs, value, text)
        _insert(rungs, current, text_of(current))
        switch = all(isinstance(value, str) for value, _ in rungs)
        return Ladder(knob.key, tuple(text for _, text in rungs), [value for value, _ in rungs].index(current), switch)

    def _value(self, key: str, text: str):
        """What the recipe makes of a value; RecipeError if it allows it neither alone nor beside a value of another knob."""
        try:
            return self.load({key: text}).leaves.get(key, text)
        except RecipeError as refusal:
            for knob in self.stage.knobs:
                for beside in knob.values if knob.key != key and isinstance(knob.default, str) else ():
                    with suppress(RecipeError):
                        return self.load({knob.key: beside, key: text}).leaves.get(key, text)
            raise refusal from None

    def allowed(self, overrides: Mapping[str, str]) -> bool:
        """Whether the recipe takes these values together."""
        try:
            self.load(overrides)
        except RecipeError:
            return False
        return True

    def overrides(self, setting: Setting) -> dict[str, str]:
        """What a setting changes in the recipe."""
        return {ladder.key: ladder.texts[i] for ladder, i in zip(self.ladders, setting, strict=True) if i != ladder.start}

    def preset(self, name: str) -> Setting:
        """Where a preset lies on the ladders."""
        values = {ladder.key: self._effective(self.job.presets[name], ladder.key) for ladder in self.ladders}
        return tuple(next((i for i, text in enumerate(ladder.texts) if self._value(ladder.key, text) == values[ladder.key]),
                          ladder.start) for ladder in self.ladders)

    def _effective(self, overrides: Mapping[str, str], key: str):
        """The value of a key under overrides, set by them or following from what they set; None where they change nothing."""
        value = self.load(overrides).leaves.get(key)
        return None if value == self.recipe.leaves.get(key) else value

    def upstream(self, tolerance: float) -> dict[str, str]:
        """Overrides under which the stages upstream are computed for a sweep; hashes are from now on with these."""
        overrides = {"tolerance": f"{tolerance:.10g}"}
        for stage in above(self.job.stages, self.recipe, self.job.stage):
            overrides = {**stage.reference, **overrides}
        self._above = hashes_above(self.job.stages, self.load(overrides), self.job.stage)
        return overrides

    def hash(self, overrides: Mapping[str, str]) -> str:
        """Input hash of the stage under overrides."""
        return hash_of(self.stage, self.load(overrides), self._above)

    def expected(self, overrides: Mapping[str, str]) -> float:
        """Seconds of one core by the stage's own model; 0 where it has no answer, which a run will then give."""
        key = tuple(sorted(overrides.items()))
        if key not in self._costs:
            try:
                self._costs[key] = self.stage.cost(self.load(overrides)).seconds
            except BakeryError:
                self._costs[key] = 0.0
        return self._costs[key]


def _is_number(value) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _insert(rungs: list[tuple], value, text: str) -> None:
    """Add a value where it fits: among numbers that rise or fall in its place, else before the dearest."""
    values: Sequence = [at for at, _ in rungs]
    if value in values:
        return
    numbers = [at for at in values if _is_number(at)]
    index = len(values)
    if _is_number(value) and len(numbers) > 1:
        falling = numbers[0] > numbers[-1]
        index = next((i for i, at in enumerate(values) if not _is_number(at) or (at < value) == falling), len(values))
    rungs.insert(index, (value, text))


def text_of(value) -> str:
    """A recipe value as a recipe's text."""
    return str(value).lower() if isinstance(value, bool) else f"{value:.10g}" if isinstance(value, float) else str(value)
