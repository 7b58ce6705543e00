"""How often `bake trade SCENE` names the method that a longer measurement, with another seed, finds the quickest.

    python -m benchmarks.trade_scenes --budget 1 --full 3 --width 32 candle cube_of_beads beads_in_box

Both calls are those of a user; pictures and records stay in build/trade_scenes, and a second call goes on with them.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from pathlib import Path

SCENES = ("candle", "cube_of_beads", "beads_in_box", "bumpy_ball", "lamp_in_dust", "heap_of_sand", "glass_of_milk",
          "snow_at_night", "wet_beside_dry", "soap_and_lamp", "bust")
ROOT = Path(__file__).parents[1]


def traded(scene: str, budget: float, seed: int, width: int, folder: Path) -> dict:
    """What `bake trade` finds of a shipped scene within so many minutes, at `width` x 3/4 `width` pixels."""
    call = [sys.executable, "-m", "bakery", "trade", ROOT / "assets" / "scenes" / f"{scene}.yaml", "--json", "--quiet",
            "--budget", str(budget), "--seed", str(seed), "--set", f"film={{width: {width}, height: {width * 3 // 4}}}",
            "-o", folder / f"{scene}_{seed}.html"]
    return json.loads(subprocess.run(call, check=True, stdout=subprocess.PIPE, cwd=ROOT).stdout)["trade"]


def judged(short: dict, full: dict) -> dict:
    """Whether the advice of a short measurement holds in a longer one.

    Returns
    -------
    row : dict with `advised`, `quickest` (by the longer one), `ratio` of their times in the longer one (inf where what was
        advised does not meet the tolerance), `alike` (whether the longer one does not distinguish them), `undecided` (the others
        that the advice does not distinguish)
    """
    advised, best = short["advised"], full["advised"]
    found = full["until"].get(advised["name"])
    return {"advised": advised["name"], "quickest": best["name"], "ratio": found / best["seconds"] if found else float("inf"),
            "alike": advised["name"] in (best["name"], *best["alike"]), "undecided": advised["alike"]}


def main() -> None:
    """Prints a row a scene, and how often the advice held."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", default=SCENES)
    parser.add_argument("--budget", type=float, default=1.0, help="minutes of the measurement that is judged")
    parser.add_argument("--full", type=float, default=3.0, help="minutes of the longer one")
    parser.add_argument("--width", type=int, default=32)
    asked = parser.parse_args()
    folder = ROOT / "build" / "trade_scenes"
    folder.mkdir(parents=True, exist_ok=True)
    rows = []
    for scene in asked.scenes:
        short = traded(scene, asked.budget, 0, asked.width, folder)
        full = traded(scene, asked.full, 1000, asked.width, folder)
        if short["advised"] is None or full["advised"] is None:
            print(f"{scene}: nothing meets the tolerance of {100 * full['tolerance']:g} %", flush=True)
            continue
        rows.append(row := judged(short, full))
        print(f"{scene}: to {100 * full['tolerance']:g} % {row['advised']}; quickest {row['quickest']} "
              f"({full['advised']['seconds']:.3g} s); times {row['ratio']:.3g}, "
              f"{'not distinguished' if row['alike'] else 'distinguished'}; advice leaves open: "
              f"{', '.join(row['undecided']) or 'none'}", flush=True)
    same, alike = (sum(row["advised"] == row["quickest"] for row in rows), sum(row["alike"] for row in rows))
    print(f"of {len(rows)}: {same} the quickest, {alike} the quickest or not distinguished from it")


if __name__ == "__main__":
    main()
