"""`python -m renderers.mitsuba SCENE.xml|ASSET -o IMAGE`: a scene with bakery's plugins, or the preview of an asset.

A program, which nothing imports: so it may call the preview, which stands above this package.
"""

from __future__ import annotations

import argparse
import sys

from bakery.errors import BakeryError
from bakery.grammar.qualities import QUALITIES
from bakery.system import streams
from bakery.system.terminal import remark, say


def main(arguments=None) -> int:
    parser = argparse.ArgumentParser(prog="python -m renderers.mitsuba", description=__doc__)
    parser.add_argument("source", help="a Mitsuba scene (.xml), or a baked asset")
    parser.add_argument("-o", "--output", required=True, help="X.png or X.exr; both are written")
    parser.add_argument("--quality", default="preview", choices=list(QUALITIES))
    parser.add_argument("--variant")
    parser.add_argument("--spp", type=int)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--overwrite", action="store_true", help="replace also files of other kinds")
    options = parser.parse_args(arguments)
    try:
        import renderers.materials.bodies.plugin
        import renderers.materials.grains.plugin  # noqa: F401
        from renderers.mitsuba import render_scene
        from renderers.preview import preview

        common = {"variant": options.variant, "spp": options.spp, "seed": options.seed, "overwrite": options.overwrite,
                  "progress": _show if sys.stderr.isatty() else None}
        if options.source.lower().endswith(".xml"):
            report = render_scene(options.source, options.output, **common)
        else:
            report = preview(options.source, options.output, quality=options.quality, **common)
        for key, value in report.items():
            say(f"{key}: {value}")
        sys.stdout.flush()
    except BakeryError as error:
        remark(str(error))
        return error.exit_status
    except KeyboardInterrupt:
        remark("interrupted; no picture was written")
        return 130
    return 0


def _show(fraction, noise):
    print(f"\r{100 * fraction:3.0f} %" + ("" if noise is None else f"   noise {noise:.3f}"), end="", file=sys.stderr)


if __name__ == "__main__":
    streams.prepare()
    status = main()
    streams.flush()
    sys.exit(status)
