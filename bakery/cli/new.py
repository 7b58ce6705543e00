"""`bake new KIND`: a commented recipe to start from, a published material, a scene; or a scene of one's own mesh."""

import math
import re
from pathlib import Path

import click

from bakery.cli import offers
from bakery.cli.options import json_option, print_json, print_paths
from bakery.errors import UsageError


@click.command(name="new", short_help="write a recipe or a scene to start from")
@click.argument("kind", default="", metavar="[KIND]", shell_complete=offers.starts)
@click.option("-o", "--output", type=click.Path(), metavar="FILE or DIR/",
              help="The recipe; DIR/, or an existing folder, gets KIND.yaml.  Default: KIND.yaml in the current folder.")
@click.option("--mesh", type=click.Path(), metavar="FILE",
              help="Also write a scene in which the material fills this closed mesh: PLY, OBJ, STL or OFF.")
@click.option("--mitsuba", type=click.Path(), metavar="FILE.xml",
              help="Also write a scene in which the material, such as fog, fills the air of this Mitsuba scene.")
@click.option("--unit", metavar="UNIT", help="Length of one unit of the mesh or the Mitsuba scene: mm, cm, m, um, km, in or ft.")
@click.option("--height", metavar="LENGTH", help='Height of the mesh, such as "12 cm".')
@click.option("--up", type=click.Choice(["z", "y"]), help="Axis of the mesh that points up.  [default: z]")
@click.option("--list", "as_list", is_flag=True, help="List all kinds, materials, recipes and scenes, as without KIND.")
@click.option("--overwrite", is_flag=True, help="Replace existing files.")
@json_option
def command(kind, output, mesh, mitsuba, as_list, overwrite, as_json, **size):
    """Write a recipe to start from: of a KIND (fog, sand, family, scene, …), of a published material (espresso, opac_fog, …), or
    a shipped recipe or scene.

    --mesh and --mitsuba also write a scene: `bake new milk --mesh drink.ply`, then `bake render milk.scene.yaml`.  With --mesh
    KIND may be a recipe of your own, tea.yaml.  Without KIND all are listed.  The recipe is named after its file; tables and
    other files that it needs are written beside it.
    """
    from bakery.store.put import put_all
    from bakery.system.terminal import remark

    _refuse_in_vain(kind, mesh, mitsuba, as_list, **size)
    if as_list or not kind:
        _list(as_json)
        return
    recipe = Path(kind) if mesh and Path(kind).suffix in (".yaml", ".yml") and Path(kind).is_file() else None
    kind = kind.removesuffix(".yaml")
    target = _target(kind if recipe is None else str(recipe.with_suffix("")), output)
    if mesh:
        from bakery.starting.studio import in_studio

        files, remarks = in_studio(recipe or kind, Path(mesh), target.stem, target.parent, unit=size["unit"],
                                   height=_metres(size["height"]), up=size["up"] or "z")
    elif mitsuba:
        files, remarks = _in_fog(kind, Path(mitsuba), target, size["unit"])
    else:
        files, remarks = _as_it_ships(kind, target), []
    files = {target.parent / name: content for name, content in files.items()}
    standing = [path for path, content in files.items() if path.exists() and not _is(path, content)]
    if standing and not overwrite:
        raise UsageError(f"{standing[0]}: exists already; choose another file with -o, or replace it with --overwrite")
    written = [str(path) for path in put_all(files)]
    if as_json:
        print_json({"kind": kind, "files": written, "remarks": remarks})
        return
    print_paths(written)
    for line in remarks:
        remark(line)
    if mesh or mitsuba:
        remark(f"bake render {target.with_suffix('.scene.yaml')}")


def _refuse_in_vain(kind, mesh, mitsuba, as_list, unit, height, up):
    from bakery.starting.meshes import UNITS

    if mesh and mitsuba:
        raise UsageError("--mesh and --mitsuba: found both; a material fills a mesh or the air of a scene: use one of them")
    if (mesh or mitsuba) and (as_list or not kind):
        raise UsageError("found no KIND; expected a material, as in `bake new milk --mesh drink.ply`")
    for option, value, needed in (("--unit", unit, mesh or mitsuba), ("--height", height, mesh), ("--up", up, mesh)):
        if value and not needed:
            raise UsageError(f"{option}: found without --mesh{' or --mitsuba' * (option == '--unit')}; it has no other use")
    if unit and unit not in UNITS:
        raise UsageError(f'--unit: found "{unit}"; expected {", ".join(UNITS)}')


def _metres(height):
    from bakery.grammar.units import LENGTH, asked

    if height is None:
        return None
    return 1e-6 * asked("--height", height, LENGTH, (0, math.inf), 'a length above 0, such as "12 cm"')


def _target(kind, output) -> Path:
    target = Path(output or "")
    if (output or "").endswith("/") or target.is_dir():
        target /= f"{kind}.yaml"
    if target.suffix not in (".yaml", ".yml"):
        raise UsageError(f"{target}: found a name that does not end in .yaml; expected {target.with_suffix('.yaml')}")
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_-]{0,63}", target.stem):
        raise UsageError(f'{target}: found "{target.stem}", which cannot be the name of a recipe; use letters, digits, - and _')
    return target


def _as_it_ships(kind, target):
    from bakery.recipe.starting import starts
    from bakery.starting.shipped import scene

    recipes = starts()
    if kind not in recipes:
        return scene(kind).files(target.stem)
    files = recipes[kind].files(target.stem)
    return {target.name: files.pop(f"{target.stem}.yaml")} | files


def _in_fog(kind, mitsuba, target, unit):
    from bakery.starting.foggy import filled
    from bakery.starting.materials import air
    from renderers.mitsuba.extent import seen

    material = air(kind)
    if mitsuba.suffix.lower() != ".xml" or not mitsuba.is_file():
        raise UsageError(f"{mitsuba}: there is no such .xml file; expected a scene of Mitsuba")
    return filled(material, mitsuba, target.parent, target.stem, seen(mitsuba), unit)


def _is(path, content) -> bool:
    """Whether a file has this content already: recipes and meshes that several scenes share."""
    data = content.encode() if isinstance(content, str) else content
    return path.is_file() and path.stat().st_size == len(data) and path.read_bytes() == data


def _list(as_json: bool) -> None:
    from bakery.recipe.starting import KINDS, PUBLISHED, SHIPPED, starts
    from bakery.starting.materials import AIRS, FILLINGS
    from bakery.starting.shipped import scenes
    from bakery.system.terminal import say, table

    recipes, pictures = starts().values(), scenes().values()
    if as_json:
        print_json([{"name": start.name, "published": start.folder == PUBLISHED, "shipped": start.folder == SHIPPED,
                     "scene": False, "about": start.about} for start in recipes]
                   + [{"name": scene.name, "published": False, "shipped": True, "scene": True, "about": scene.about}
                      for scene in pictures])
        return
    titles = {KINDS: "kinds", PUBLISHED: "published materials (docs/catalogue.md)", SHIPPED: "recipes that ship (recipes/)"}
    groups = {title: [(start.name, start.about) for start in recipes if start.folder == folder]
              for folder, title in titles.items()}
    groups["scenes that ship (docs/gallery.md), with all files"] = [(scene.name, scene.about) for scene in pictures]
    for title, rows in groups.items():
        say(f"{title}:")
        for line in table(rows):
            say(f"  {line}")
    say("`bake new NAME -o FILE.yaml` writes one")
    say(f"`bake new NAME --mesh FILE` writes a scene of a mesh of {', '.join(FILLINGS)}")
    say(f"`bake new NAME --mitsuba FILE.xml` fills the air of a scene with {', '.join(AIRS)}")
