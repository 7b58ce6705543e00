"""Points beside beams: what method `beams` gains by events of light near lines of sight.

    python -m benchmarks.points [--small] [--scenes wax wax_glass bumpy_ball candle glass_of_milk] [--size 32] [--seconds 20]

Scenes: a ball of published wax of 8 mean free paths in radius under a panel, matched or of glass, and shipped ones.  A row for
beams at the events of all walks, without points, and one for `beams` as it is; `metropolis`, or else `paths`, is the
reference.  They take turns, for so many processor seconds each.  Light of three and more events over that of the reference, with
its standard error; bias of blocks of pixels, with the range that it is in 18 times of 20; processor seconds to a noise of 1 % of
a pixel, root mean square; that over the first row's; and seconds a pass.  --small: 8 pixels wide, three passes.
"""

import argparse
from contextlib import ExitStack
from unittest import mock

from benchmarks.figures_translucent import stand
from benchmarks.metropolis_tables import setup
from benchmarks.sizes import sized
from renderers.materials.bodies import beams, events
from renderers.mitsuba import variants

SCENES = ["wax", "wax_glass", "bumpy_ball", "candle", "glass_of_milk"]
ROUNDS = 2
WITHOUT, WITH = "beams, no points", "beams"


def without_points(render):
    """A kind of passes without points: beams begin at the events of all walks, of as few as can be."""
    discs, joins = events.discs, beams.joins

    def alone(number):
        with ExitStack() as changes:
            for module, name, other in [
                    (events, "APART", 1), (events, "_WALKS", (events._WALKS[0],) * 2),
                    (events, "discs", lambda width: (discs(width)[0], 0 * width)),
                    (beams, "joins", lambda setup, sets, points=(), **others: joins(setup, sets, **others))]:
                changes.enter_context(mock.patch.object(module, name, other))
            return render(number)

    return alone


class Alone(stand.Run):
    """`beams` without points."""

    def __init__(self, how):
        super().__init__(how, WITH, kinds=())
        block = stand.blocks(how)
        self.parts = [stand.Passes(part._replace(render=without_points(part.render)), block)
                      for part in stand.methods.parts(how, WITH, "negative", 0)]


def rows(scene, size, seconds):
    """Measures a scene and prints its rows."""
    how = setup(scene, size)
    reference = "paths" if how.chained else "metropolis"
    runs = {reference: stand.Run(how, reference), WITHOUT: Alone(how), WITH: stand.Run(how, WITH)}
    stand.together(runs, dict.fromkeys(runs, seconds), ROUNDS)
    first, *others = (run.found(stand.LATER) for run in runs.values())
    for name, its in zip((WITHOUT, WITH), others, strict=True):
        joined = runs[name].parts[-1]
        print(f"| {scene} | `{name}` | {stand.over(*stand.ratio(its, first))} | {stand.of_bias(*stand.bias(its, first))} | "
              f"{stand.of_seconds(its.seconds)} | {its.seconds / others[0].seconds:.2f} | {joined.seconds / joined.count:.2f} |",
              flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", nargs="+", default=sized(SCENES, ["bumpy_ball"]))
    parser.add_argument("--size", type=int, default=sized(32, 8), help="pixels a side, a multiple of 8")
    parser.add_argument("--seconds", type=float, default=sized(20.0, 0.0))
    args = parser.parse_args()
    print(variants.activate("rgb"))
    print("| scene | method | three and more events over the reference | bias, % | noise 1 % after, s | over without points | "
          "a pass, s |\n|" + "---|" * 7, flush=True)
    for scene in args.scenes:
        rows(scene, args.size, args.seconds)


if __name__ == "__main__":
    main()
