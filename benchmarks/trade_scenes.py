"""How often `bake trade SCENE` names the method that a longer measurement, with another seed, finds the quickest.

    python -m benchmarks.trade_scenes --budget 1 --full 3 --width 32 candle cube_of_beads beads_in_box

Both calls are those of a user; pictures and records stay in build/trade_scenes, and a second call goes on with them.
"""

import argparse
import json
import subprocess
import sys
from pathlib import Path

from bakery.scenes.methods import curves
from bakery.trade import methods
from benchmarks.sizes import sized

SCENES = ("candle", "cube_of_beads", "beads_in_box", "bumpy_ball", "lamp_in_dust", "heap_of_sand", "glass_of_milk",
          "snow_at_night", "wet_beside_dry", "soap_and_lamp", "bust")
TOLERANCES = (3.0, 1.0, 1 / 3)  # times the scene's
ROOT = Path(__file__).parents[1]


def traded(scene: str, budget: float, seed: int, width: int, folder: Path) -> dict:
    """What `bake trade` finds of a shipped scene within so many minutes, at `width` x 3/4 `width` pixels."""
    call = [sys.executable, "-m", "bakery", "trade", ROOT / "assets" / "scenes" / f"{scene}.yaml", "--json", "--quiet",
            "--budget", str(budget), "--seed", str(seed), "--set", f"film={{width: {width}, height: {width * 3 // 4}}}",
            "-o", folder / f"{scene}_{seed}.html"]
    return json.loads(subprocess.run(call, check=True, stdout=subprocess.PIPE, cwd=ROOT).stdout)


def judged(short: dict, full: dict, tolerance: float) -> dict | None:
    """Whether the advice of a short measurement for a tolerance holds in a longer one; None where no method meets it in one.

    Returns
    -------
    row : dict with `advised`, `quickest` (by the longer one), `ratio` of their times in the longer one (inf where what was
        advised does not meet the tolerance), `alike` (whether the longer one does not distinguish them), `undecided` (the others
        that the advice does not distinguish)
    """
    (said, _), (best, known) = ((methods.advised(found, tolerance), found) for found in map(curves, (short, full)))
    if said is None or best is None:
        return None
    seconds = next(curve for curve in known if curve.name == said["name"]).until(tolerance)
    return {"advised": said["name"], "quickest": best["name"], "ratio": seconds / best["seconds"],
            "alike": said["name"] in (best["name"], *best["alike"]), "undecided": said["alike"] + said["open"]}


def main() -> None:
    """Prints a row a scene and tolerance, and how often the advice held."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", default=sized(SCENES, SCENES[:1]))
    parser.add_argument("--budget", type=float, default=sized(1.0, 0.1), help="minutes of the measurement that is judged")
    parser.add_argument("--full", type=float, default=sized(3.0, 0.1), help="minutes of the longer one")
    parser.add_argument("--width", type=int, default=sized(32, 8))
    asked = parser.parse_args()
    folder = ROOT / "build" / "trade_scenes"
    folder.mkdir(parents=True, exist_ok=True)
    rows = []
    for scene in asked.scenes:
        short = traded(scene, asked.budget, 0, asked.width, folder)
        full = traded(scene, asked.full, 1000, asked.width, folder)
        for tolerance in (share * full["trade"]["tolerance"] for share in TOLERANCES):
            row = judged(short, full, tolerance)
            if row is None:
                print(f"{scene}, {100 * tolerance:.3g} %: met by none", flush=True)
                continue
            rows.append(row)
            print(f"{scene}, {100 * tolerance:.3g} %: {row['advised']}; quickest {row['quickest']}, times {row['ratio']:.3g}, "
                  f"{'not distinguished' if row['alike'] else 'distinguished'}; the advice leaves open: "
                  f"{', '.join(row['undecided']) or 'none'}", flush=True)
    same, alike, left = (sum(which(row) for row in rows) for which in (
        lambda row: row["advised"] == row["quickest"], lambda row: row["alike"],
        lambda row: row["alike"] or row["quickest"] in row["undecided"]))
    print(f"of {len(rows)}: {same} the quickest, {alike} not distinguished from it, {left} with what the advice leaves open")


if __name__ == "__main__":
    main()
