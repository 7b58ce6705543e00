"""A page of claims that are measured again: what the commands of `figures_goa`, `figures_discrete`, `figures_granular`,
`figures_translucent` share."""

import argparse
import importlib
import io
import re
import time
from pathlib import Path

from bakery.draw.style import look, saved
from benchmarks.sizes import docs


def filled(page, tables, name="goa-claims.md"):
    """The page with each table between its two marks replaced."""
    for table, text in tables.items():
        page, count = re.subn(rf"(<!-- numbers: {re.escape(table)} -->\n)(?:(?!<!--).)*(<!-- end -->)",
                              lambda mark: mark[1] + text + "\n" + mark[2], page, flags=re.DOTALL)
        if count != 1:
            raise SystemExit(f"{name} has {count} places for '{table}'; it wants one '<!-- numbers: {table} -->' with its "
                             "'<!-- end -->'")
    return page


def small(figure, colours=64):
    """PNG of at most so many colours: lines and letters do not miss more than 64."""
    from PIL import Image

    picture = Image.open(io.BytesIO(saved(figure, ("png",))["png"])).convert("RGB").quantize(colours, dither=Image.Dither.NONE)
    buffer = io.BytesIO()
    picture.save(buffer, "png", optimize=True)
    return buffer.getvalue()


def command(package, description, claims, name, settings=None):
    """Measures claims, prints their tables, puts them into the page and saves the pictures beside it.

    Parameters
    ----------
    package : holds the modules
    claims : dict, name on the command line -> (module, picture or None); COLOURS of a module are those of its picture
    name : of the page in docs/; a module's PAGE takes its place
    settings : dict, parameter of every `measure` -> (kind, value if not said, what it is): options of the command
    """
    parser = argparse.ArgumentParser(prog=f"python -m {package}", description=description)
    parser.add_argument("--only", nargs="+", choices=claims, default=list(claims), metavar="CLAIM", help=", ".join(claims))
    parser.add_argument("--docs", type=Path, default=docs(),
                        help=f"folder of {name} and pictures/")
    for setting, (kind, usual, what) in (settings or {}).items():
        parser.add_argument(f"--{setting}", type=kind, default=usual, help=f"{what}; {usual}")
    asked = parser.parse_args()
    start = time.perf_counter()
    (asked.docs / "pictures").mkdir(exist_ok=True)
    import matplotlib

    matplotlib.use("Agg")
    for i, chosen in enumerate(asked.only):
        module, picture = claims[chosen]
        print(f"[{i + 1}/{len(asked.only)}] {chosen}: {module.replace('_', ' ')} ...", flush=True)
        claim = importlib.import_module(f"{package}.{module}")
        numbers = claim.measure(**{setting: getattr(asked, setting) for setting in settings or {}})
        tables = claim.tables(numbers)
        print("\n\n".join(tables.values()), flush=True)
        page = asked.docs / getattr(claim, "PAGE", name)
        page.write_text(filled(page.read_text(encoding="utf-8"), tables, page.name), encoding="utf-8")
        if picture:
            with look(picture), matplotlib.rc_context({"savefig.dpi": 120}):
                (asked.docs / "pictures" / picture).write_bytes(small(claim.draw(numbers), getattr(claim, "COLOURS", 64)))
            print(f"picture: {asked.docs / 'pictures' / picture}", flush=True)
        print(f"{time.perf_counter() - start:.0f} s", flush=True)
