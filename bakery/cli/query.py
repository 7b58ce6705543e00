"""`bake query ASSET PATH [key=value …]`: one baked value, or one looked up."""

from __future__ import annotations

import difflib

import click

from bakery.cli import offers
from bakery.cli.inspect import not_found
from bakery.cli.options import at_option, json_option, opened, print_json
from bakery.errors import UsageError


@click.command(name="query", short_help="print one baked value")
@click.argument("asset", type=click.Path(), metavar="ASSET")
@click.argument("path", metavar="PATH", shell_complete=offers.datasets)
@click.argument("arguments", nargs=-1, metavar="[key=value …]")
@at_option
@json_option
def command(asset, path, arguments, place, as_json):
    """Print the value at PATH of ASSET, such as medium/sigma_t, or look it up at arguments with units.

    \b
    bake query fog.h5 medium/sigma_t wavelength=0.55um
    bake query fog.h5 medium/phase wavelength=0.55um theta=10deg
    bake query fog.h5 medium/phase "theta=[0, 90, 180] deg"
    bake query milk.h5 multiple/point rho=1 z=2 theta=30deg
    bake query clouds.h5 medium/g --at radius=5um
    """
    from bakery.asset.lookup import lookup
    from bakery.stages import all_stages
    from bakery.store.tree import Group, is_text, read_text

    found = opened(asset, place)
    root, path = found.tree, path.strip("/")
    queries = {query.path: query for stage in all_stages() for query in stage.queries}
    values = dict(_argument(word, queries.values()) for word in arguments)
    if len(values) < len(arguments):
        raise UsageError("the same argument twice; give each once")
    member = _find(asset, root, path)
    if path in queries and values:
        _show(root, queries[path].answer(found, path, values), as_json)
        return
    if isinstance(member, Group):
        content = ", ".join([*member.members, *member.attributes])
        raise UsageError(f"{asset}: {path} is a group; it holds {content}: ask for one of them, "
                         f"such as {path}/{content.split(',')[0]}")
    attribute = not hasattr(member, "data")
    if attribute or is_text(member):
        if values:
            raise UsageError(f"{path}: {next(iter(values))} has no effect on it; it takes no arguments")
        _print_plain(path, member if attribute else read_text(member), as_json)
        return
    _show(root, lookup(root, path, values), as_json)


def _show(root, answer, as_json: bool) -> None:
    stage = _stage_of(root, answer)
    if as_json:
        _print_json(answer, stage)
    else:
        _print(answer, stage)


def _argument(word: str, queries):
    """`theta=10deg` as ("theta", 0.17): lengths in um, angles in rad."""
    from bakery.grammar.units import ANGLE, LENGTH, WAVELENGTH, Wrong, is_list, parse, parse_list

    kinds = {"wavelength": WAVELENGTH, "theta": ANGLE, "radius": LENGTH}
    for query in queries:
        kinds |= query.arguments
    key, equals, text = word.partition("=")
    if not equals or key not in kinds:
        near = difflib.get_close_matches(key, kinds, 1)
        raise UsageError(f'found "{word}"; ' + (f"did you mean {near[0]}=…?" if near and key not in kinds else
                         "; ".join(["arguments are wavelength=0.55um, theta=10deg, radius=5um",
                                    *(f"of {query.path} {query.example}" for query in queries)])))
    try:
        value = parse_list(text, kinds[key]) if is_list(text) else parse(text, kinds[key])
    except Wrong as wrong:
        raise UsageError(f"{key}: {wrong.found}; {wrong.expected}") from None
    return key, value


def _find(asset: str, root, path: str):
    """A dataset or group, or the value of an attribute (medium/achieved_error)."""
    if not path:
        return root
    from bakery.family.tree import is_family
    from bakery.stages.conform import FAMILY

    try:
        return root[path]
    except KeyError:
        pass
    parent, _, name = path.rpartition("/")
    try:
        return getattr(root[parent] if parent else root, "attributes", {})[name]
    except KeyError:
        pass
    if is_family(root) and path.partition("/")[0] != FAMILY:
        raise UsageError(f"{asset}: is a family, so {path} is one of each of its places; --at says which")
    names = [name for name, _ in root.walk()]
    names += [f"{name}/{key}" for name, member in root.walk() for key in getattr(member, "attributes", ())]
    raise UsageError(not_found(asset, path, names + list(root.attributes)))


def _stage_of(root, answer) -> dict | None:
    """What the stage behind figures says of itself (`summary.stage`): where they have no error of their own, or where it misses.

    An error of exactly 0 is none: the figure follows from a formula, and how far that is from the truth is known to the stage.
    """
    from bakery.asset.summary import stage

    name = answer.path.partition("/")[0]
    attributes = getattr(root.members[name], "attributes", {})
    if "achieved_error" not in attributes or answer.values.dtype.kind != "f":
        return None
    summary = stage(root, name)
    return summary if answer.error is None or not answer.error.any() or summary["missed"] else None


def _print_plain(path: str, value, as_json: bool) -> None:
    from bakery.asset.summary import number
    from bakery.system.terminal import clean, say, say_all

    if as_json:
        print_json({"path": path, "value": number(value)})
    elif isinstance(value, str) and "\n" in value:
        say_all(value)
    else:
        say(clean(value))


def _print_json(answer, stage) -> None:
    import numpy as np

    def plain(array):
        finite = np.where(np.isfinite(array), array, None) if array.dtype.kind == "f" else array
        return finite.tolist()

    print_json({
        "path": answer.path, "units": answer.units, "value": plain(answer.values),
        "axes": [{"name": name, "units": unit, "values": plain(at)} for name, unit, at in answer.axes],
        "error": None if answer.error is None else plain(answer.error),
        **{f"stage_{key}": stage and stage[key] for key in ("tolerance", "missed")},
        "stage_error": stage and stage["achieved_error"], "error_measure": stage["error_measure"] if stage else "",
        "methods": [dict(values) for remark in answer.remarks for values in remark.values],
        "remarks": [remark.text for remark in answer.remarks]})


def _print(answer, stage) -> None:
    from bakery.system.terminal import clean, say, table

    unit = "" if answer.units == "1" else f" {clean(answer.units)}"
    if answer.values.ndim == 0:
        error = f" +- {float(answer.error):.2g}" if answer.error is not None and answer.error else ""
        say(f"{_digits(answer.values[()])}{error}{unit}")
    else:
        for line in table(_rows(answer), right=range(answer.values.ndim + 64)):
            say(line)
    for remark in answer.remarks:
        say(f"# {remark.text}")
    if stage is not None and stage["missed"]:
        say(f"# MISSED by stage {stage['group']}: {clean(stage['missed'])}; the error is the {clean(stage['error_measure'])}")
    elif stage is not None:
        say(f"# error of the stage {stage['achieved_error']:.2g}: {clean(stage['error_measure'])}")


def _rows(answer):
    """One row for each place of the last axis; the columns go over what is before it (one column a wavelength)."""
    import numpy as np

    *across, (name, unit, at) = answer.axes
    columns = [(f"{name} [{unit}]", at)]
    quantity = answer.path.rpartition("/")[2]
    for index in np.ndindex(answer.values.shape[:-1]):
        places = zip(across, index, strict=True)
        place = ", ".join(f"index {i}" if name == "index" else f"{axis[i]:g} {unit}" for (name, unit, axis), i in places)
        head = f"{quantity} [{answer.units}]" + (f" at {place}" if place else "")
        columns.append((head, answer.values[index]))
        if answer.error is not None:
            columns.append((f"+- at {place}" if place else "+-", answer.error[index]))
    yield [head for head, _ in columns]
    for i in range(answer.values.shape[-1]):
        yield [_digits(values[i]) for _, values in columns]


def _digits(value) -> str:
    """As many digits as distinguish a float from its neighbours."""
    return str(value.item() if hasattr(value, "item") else value)
