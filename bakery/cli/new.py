"""`bake new KIND`: a commented recipe to start from, or one of the published materials."""

from __future__ import annotations

import re
from pathlib import Path

import click

from bakery.cli import offers
from bakery.cli.options import json_option, print_json, print_paths
from bakery.errors import UsageError


@click.command(name="new", short_help="write a commented recipe to start from")
@click.argument("kind", default="", metavar="[KIND]", shell_complete=offers.starts)
@click.option("-o", "--output", type=click.Path(), metavar="FILE or DIR/",
              help="The recipe; DIR/, or a folder that is there, takes KIND.yaml.  Default: KIND.yaml in the current folder.")
@click.option("--overwrite", is_flag=True, help="Write over what stands there.")
@click.option("--force", is_flag=True, hidden=True)
@json_option
def command(kind, output, overwrite, force, as_json):
    """Write a recipe of a KIND (fog, sand, family, scene, …), of a published material (espresso, opac_fog, …), or one that ships.

    Without KIND all are listed.  The recipe takes the file's name; tables and other files that it needs are
    written beside it, by the same name.
    """
    from bakery.recipe.starting import start, starts
    from bakery.store.put import put
    from bakery.system.terminal import remark

    if not kind:
        _list(starts().values(), as_json)
        return
    if force:
        remark("--force is called --overwrite here, as everywhere")
    found = start(kind.removesuffix(".yaml"))
    target = Path(output or "")
    if (output or "").endswith("/") or target.is_dir():
        target /= f"{found.name}.yaml"
    if target.suffix not in (".yaml", ".yml"):
        raise UsageError(f"{target}: found a name that does not end in .yaml; {target.with_suffix('.yaml')} would do")
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_-]{0,63}", target.stem):
        raise UsageError(f'{target}: found "{target.stem}", which cannot be the name of a recipe; use letters, digits, - and _')
    files = {target: found.text(target.stem)}
    files |= {target.with_suffix(path.suffix): path.read_text(encoding="utf-8") for path in found.beside()}
    standing = [path for path in files if path.exists()]
    if standing and not (overwrite or force):
        raise UsageError(f"{standing[0]}: is there already; choose another file with -o, or write over it with --overwrite")
    written = [str(put(path, text)) for path, text in files.items()]
    if as_json:
        print_json({"kind": kind, "files": written})
    else:
        print_paths(written)


def _list(starts, as_json: bool) -> None:
    from bakery.recipe.starting import KINDS, PUBLISHED, SHIPPED
    from bakery.system.terminal import say, table

    if as_json:
        print_json([{"name": start.name, "published": start.folder == PUBLISHED, "shipped": start.folder == SHIPPED,
                     "about": start.about} for start in starts])
        return
    titles = {KINDS: "kinds", PUBLISHED: "published materials (docs/catalogue.md)", SHIPPED: "recipes that ship (recipes/)"}
    for folder, title in titles.items():
        rows = [(start.name, start.about) for start in starts if start.folder == folder]
        say(f"{title}:")
        for line in table(rows):
            say(f"  {line}")
    say("`bake new NAME -o FILE.yaml` writes one")
