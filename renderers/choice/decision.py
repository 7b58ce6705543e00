"""What `auto` has chosen, and what reports say of it."""

from collections.abc import Sequence
from typing import NamedTuple

from renderers.scene import candidates, entries
from renderers.scene.budget import percent

TEXT = "bakery_method"  # attribute of the pictures


class Choice(NamedTuple):
    """What was chosen.

    Attributes
    ----------
    method : name
    methods : of each entry
    table : of each candidate a dict: `method`, `seconds` (of processors, to the noise that is asked for), `at_most` (the same,
        with what standard errors may add), `bias` and `error` (over the picture's mean; 0 of one without), `chosen`, `why`; None
        of what is not known
    approximations : error of the method in this scene with what two standard errors may add; None where the pilots do not tell
    sentence : how it was chosen
    foretold : of the picture by the method, as `Trial.summary` gives it; None without a pilot
    spent : processor seconds of the pilots, when they were rendered; kernels were compiled before
    """

    method: str
    methods: list[str]
    table: list[dict]
    approximations: float | None
    sentence: str
    foretold: dict | None = None
    spent: float = 0.0

    @property
    def row(self) -> dict:
        """Of the table, the method's."""
        return next(row for row in self.table if row["chosen"])

    @property
    def reasons(self) -> list[str]:
        """Sentences of a report."""
        return [self.sentence, *(f"  {row['method']}: {_figures(row)}{row['why']}" for row in self.table)]

    def of_entries(self, listed: Sequence[dict]) -> list[dict]:
        """What a report says of each entry where methods mix, with what the pilots showed: of media that stand for materials how
        far the picture is off by them together."""
        why, told = f"{_figures(self.row)}{self.row['why']}", []
        for entry in listed:
            stands = candidates.medium_for(entry["kind"]) or entries.has_surface(entry["kind"], entry["method"])
            bias = {"bias": self.approximations, "reasons": [*entry["reasons"], why]} if entry["bias"] is None else {}
            told.append(entry | ({"pilot": self.table} if stands else {}) | bias)
        return told

    def text(self) -> dict[str, str]:
        """Attributes of the pictures: no seconds, so that the same scene gives the same bytes."""
        return {TEXT: self.method}


def _figures(row):
    if row["seconds"] is None:
        return ""
    bias = "" if not row["bias"] and not row["error"] else f", bias {percent(row['bias'])} +- {percent(row['error'])}"
    at_most = f" (at most {row['at_most']:.3g} s)" if row.get("at_most", row["seconds"]) != row["seconds"] else ""
    return f"{row['seconds']:.3g} s{at_most}{bias}; "
