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
    outputs: dict[str, list[Output]] = {}
    seen: dict[str, set[str]] = {}
    for stage in all_stages():
        paths = seen.setdefault(stage.name, set())
        new = [output for output in stage.outputs if output.path not in paths]
        if new:
            outputs[f"{stage.name} from {stage.needs[-1]}" if paths else stage.name] = new
        paths.update(output.path for output in new)
    return outputs


def table(outputs: Iterable[Output]) -> str:
    """The rows of a table: datasets that differ in their place alone share one, standard errors stand with their figure."""
    outputs = list(outputs)
    paths = {output.path for output in outputs}
    errors = {output.path.removesuffix(ERROR) for output in outputs if _plain_error(output)} & paths
    rows: dict[tuple[str, str, str], list[str]] = {}
    some = not all(output.optional for output in outputs)  # where all are, one line below the table says so
    for output in outputs:
        if _plain_error(output) and output.path.removesuffix(ERROR) in errors:
            continue
        units = f"enum: {', '.join(output.choices)}" if output.choices else "text" if output.units == "utf-8" else output.units
        mark = "?" * (output.optional and some)
        rows.setdefault((output.shape, units, mark + output.description.replace("|", "\\|")), []).append(
            f"`{output.path}`" + " ±" * (output.path in errors))
    lines, first = [], {}
    for (shape, units, description), names in rows.items():
        name, words = _together(names), description.removeprefix("?")
        same = first.setdefault(words, name)
        if same != name:  # another shape of what stands above
            words = f"as {same.split(',')[0].removesuffix(' ±')}"
        lines.append(f"| {name}{'?' * (description[0] == '?')} | {shape} | {units} | {words} |")
    return "\n".join(["| dataset | shape | units | |", "|---|---|---|---|", *lines, *["", "All are optional."] * (not some), ""])


def _together(names: list[str]) -> str:
    """Names of one row; those that differ by a place before them as one: `[TILE/]radii`, `SOURCE/error`."""
    if len(names) == 2 and names[1] == names[0].replace("`", "`TILE/", 1):
        return names[0].replace("`", "`[TILE/]", 1)
    if len(names) == 2 and names[0].replace("`point/", "`segment/") == names[1] != names[0]:
        return names[0].replace("`point/", "`SOURCE/")
    return ", ".join(names)


def _plain_error(output: Output) -> bool:
    """Whether a dataset is the standard error of another, or its standard deviation over realisations."""
    figure = output.path.rpartition("/")[2].removesuffix(ERROR)
    words = tuple(f"standard {kind} of {figure}" for kind in ("error", "deviation"))
    return output.path.endswith(ERROR) and output.description.startswith(words)


def current(page: str) -> str:
    """The page with its tables as the stages declare them now.

    Raises
    ------
    ValueError : it has no place for a table, or one for a table that there is not
    """
    tables = declared()
    places = [match[1] for match in _PLACE.finditer(page)]
    if sorted(places) != sorted(tables):
        wrong = ", ".join(sorted(set(places) ^ set(tables))) or "one of them twice"
        raise ValueError(f"tables of {', '.join(tables)} belong into the page; found another number of: {wrong}")
    return _PLACE.sub(lambda match: match[1] + match[2] + table(tables[match[1]]), page)


def main() -> None:
    """Bring the pages named on the command line up to date."""
    for path in map(Path, sys.argv[1:]):
        path.write_text(current(path.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    main()
