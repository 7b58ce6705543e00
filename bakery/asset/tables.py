"""The tables of `docs/asset-format.md`, from what the stages declare: `make docs` writes them into the page.

A table stands between `<!-- datasets: NAME -->` and `<!-- end -->`; what stands around it is written by hand.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable
from pathlib import Path

from bakery.stages import all_stages
from bakery.stages.coordinates import ERROR
from bakery.stages.declaration import Output

_PLACE = re.compile(r"(?<=<!-- datasets: )([^>]+?)( -->\n)(.*?)(?=<!-- end -->)", re.DOTALL)


def declared() -> dict[str, list[Output]]:
    """What each table holds.

    A group that several stages write has a table for each that adds to it, such as `medium` and `medium from grains`.
    """
    found: dict[str, list[Output]] = {}
    seen: dict[str, set[str]] = {}
    for stage in all_stages():
        known = seen.setdefault(stage.name, set())
        own = [output for output in stage.outputs if output.path not in known]
        if own:
            found[f"{stage.name} from {stage.needs[-1]}" if known else stage.name] = own
        known.update(output.path for output in own)
    return found


def table(outputs: Iterable[Output]) -> str:
    """The rows of a table: datasets that differ in their place alone share one, standard errors stand with their figure."""
    outputs = list(outputs)
    paths = {output.path for output in outputs}
    errors = {output.path.removesuffix(ERROR) for output in outputs if _plain_error(output)} & paths
    rows: dict[tuple[str, str, str], list[str]] = {}
    for output in outputs:
        if _plain_error(output) and output.path.removesuffix(ERROR) in errors:
            continue
        units = f"enum: {', '.join(output.choices)}" if output.choices else "text" if output.units == "utf-8" else output.units
        said = output.description.replace("|", "\\|") + " (optional)" * output.optional
        rows.setdefault((output.shape, units, said), []).append(f"`{output.path}`" + " ±" * (output.path in errors))
    lines = [f"| {', '.join(paths)} | {shape} | {units} | {said} |" for (shape, units, said), paths in rows.items()]
    return "\n".join(["| dataset | shape | units | |", "|---|---|---|---|", *lines, ""])


def _plain_error(output: Output) -> bool:
    """Whether a dataset is the standard error of another, of which no more is to be said."""
    figure = output.path.rpartition("/")[2].removesuffix(ERROR)
    return output.path.endswith(ERROR) and output.description == f"standard error of {figure}"


def current(page: str) -> str:
    """The page with its tables as the stages declare them now.

    Raises
    ------
    ValueError : it has no place for a table, or one for a table that there is not
    """
    tables = declared()
    places = [place[1] for place in _PLACE.finditer(page)]
    if sorted(places) != sorted(tables):
        wrong = ", ".join(sorted(set(places) ^ set(tables))) or "one of them twice"
        raise ValueError(f"tables of {', '.join(tables)} belong into the page; found another number of: {wrong}")
    return _PLACE.sub(lambda place: place[1] + place[2] + table(tables[place[1]]), page)


def main() -> None:
    """Bring the pages named on the command line up to date."""
    for path in map(Path, sys.argv[1:]):
        path.write_text(current(path.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    main()
