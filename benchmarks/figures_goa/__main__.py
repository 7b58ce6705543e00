"""Command line: see the package."""

from __future__ import annotations

import argparse
import importlib
import io
import re
import time
from pathlib import Path

from bakery.draw.style import look, saved

CLAIMS = {  # name on the command line: (module, picture)
    "fig2": ("orders", "goa_orders.png"), "fig3": ("extinction", "goa_extinction.png"),
    "fig4": ("amplitudes", "goa_amplitudes.png"), "fig6": ("trade", "goa_trade.png"),
    "fig11": ("diffraction", "goa_diffraction.png"),
    "fig13": ("henyey_greenstein", "goa_henyey_greenstein.png"), "rays": ("one_ray", "goa_one_ray.png"),
    "absorption": ("absorption", "goa_absorption.png"), "corrections": ("corrections", "goa_corrections.png"),
}


def filled(page, tables):
    """The page with each table between its two marks replaced."""
    for name, text in tables.items():
        page, count = re.subn(rf"(<!-- numbers: {re.escape(name)} -->\n)(?:(?!<!--).)*(<!-- end -->)",
                              lambda mark: mark[1] + text + "\n" + mark[2], page, flags=re.DOTALL)
        if count != 1:
            raise SystemExit(f"goa-claims.md has {count} places for '{name}'; it wants one '<!-- numbers: {name} -->' with its "
                             "'<!-- end -->'")
    return page


def small(figure):
    """PNG of at most 64 colours, which lines and letters do not miss."""
    from PIL import Image

    picture = Image.open(io.BytesIO(saved(figure, ("png",))["png"])).convert("RGB").quantize(64, dither=Image.Dither.NONE)
    buffer = io.BytesIO()
    picture.save(buffer, "png", optimize=True)
    return buffer.getvalue()


def main():
    parser = argparse.ArgumentParser(prog="python -m benchmarks.figures_goa", description=__doc__)
    parser.add_argument("--only", nargs="+", choices=CLAIMS, default=list(CLAIMS), metavar="CLAIM", help=", ".join(CLAIMS))
    parser.add_argument("--docs", type=Path, default=Path(__file__).resolve().parents[2] / "docs",
                        help="folder of goa-claims.md and pictures/")
    asked = parser.parse_args()
    page, start = asked.docs / "goa-claims.md", time.perf_counter()
    (asked.docs / "pictures").mkdir(exist_ok=True)
    import matplotlib

    matplotlib.use("Agg")
    for i, name in enumerate(asked.only):
        module, picture = CLAIMS[name]
        print(f"[{i + 1}/{len(asked.only)}] {name}: {module.replace('_', ' ')} ...", flush=True)
        claim = importlib.import_module(f"{__package__}.{module}")
        numbers = claim.measure()
        tables = claim.tables(numbers)
        with look(picture), matplotlib.rc_context({"savefig.dpi": 120}):
            (asked.docs / "pictures" / picture).write_bytes(small(claim.draw(numbers)))
        page.write_text(filled(page.read_text(encoding="utf-8"), tables), encoding="utf-8")
        print("\n\n".join(tables.values()) + f"\npicture: {asked.docs / 'pictures' / picture}", flush=True)
        print(f"{time.perf_counter() - start:.0f} s", flush=True)


if __name__ == "__main__":
    main()
