"""`bake plot`: processor seconds for all pictures of an asset, PNG and SVG, imports included.

    python benchmarks/pictures.py fog.h5 sand.h5 …

Each asset in a process of its own, three times; the least counts.  The first run of a fresh installation compiles kernels.
"""

import argparse
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

from benchmarks.sizes import sized

REPEATS = sized(3, 1)
WISHED = 3.0  # s


def seconds(asset: Path) -> tuple[float, int]:
    """Processor seconds (user and system) of `bake plot`, and how many pictures it made."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([sys.executable, "-m", "bakery", "plot", str(asset), "-o", folder], check=True, capture_output=True)
        count = len(list(Path(folder).glob("*.png")))
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, count


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("asset", type=Path, nargs="+")
    print("| asset | pictures | processor seconds |\n|---|---|---|")
    for asset in parser.parse_args().asset:
        found = [seconds(asset) for _ in range(REPEATS)]
        least, count = min(found)
        print(f"| {asset.stem} | {count} | {least:.2f}{' (above 3)' if least > WISHED else ''} |", flush=True)


if __name__ == "__main__":
    main()
