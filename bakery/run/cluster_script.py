"""Shell scripts that start a Dask scheduler and workers for `--cluster`, and bake there."""

import math
import shlex
import sys
from pathlib import Path

import bakery

_SLURM = """\
#SBATCH --job-name=bakery
#SBATCH --ntasks={tasks}
#SBATCH --cpus-per-task=1
#SBATCH --mem-per-cpu={memory}M
#SBATCH --time={time}
#SBATCH --output=bakery-%j.log
# {workers} workers and the scheduler.  Partition, account and the like: further #SBATCH lines, or options of sbatch.
"""
_START = {
    "local": """\
start scheduler --host 127.0.0.1 --port 0
start worker --nworkers {workers} --memory-limit {memory}MB
""",
    "slurm": """\
start scheduler --port 0
srun --ntasks={workers} --cpus-per-task=1 --kill-on-bad-exit=0 \\
    "$PYTHON" -m distributed.cli.dask_worker --scheduler-file "$FOLDER/scheduler.json" --no-dashboard \\
    --nthreads 1 --memory-limit {memory}MB --death-timeout 120 --local-directory "${{TMPDIR:-/tmp}}" &
""",
}
_SCRIPT = """\
#!/usr/bin/env bash
{head}# Starts a Dask scheduler and {workers} workers of bakery {version}.
#   {call} RECIPE…   bakes on them, with any options of a bake, and ends
#   {call}           prints the command that bakes on them, until it is ended
set -euo pipefail

PYTHON={python}
{path}export OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 NUMBA_NUM_THREADS=1  # a worker is one thread

FOLDER=$(mktemp -d "{folder}/bakery-cluster-XXXXXX")
end() {{
    trap "" INT TERM
    for pid in $(jobs -p | tac); do kill "$pid" && wait "$pid" || true; done 2>/dev/null  # workers first
    rm -rf "$FOLDER"
}}
trap end EXIT
trap 'exit 130' INT
trap 'exit 143' TERM

start() {{
    local kind=$1; shift
    local options=(--scheduler-file "$FOLDER/scheduler.json")
    [ "$kind" = scheduler ] && options+=(--no-dashboard) || options+=(--no-dashboard --nthreads 1 --local-directory "$FOLDER")
    "$PYTHON" -m "distributed.cli.dask_$kind" "${{options[@]}}" "$@" 2>>"$FOLDER/$kind.log" &
}}

{start}
until [ -s "$FOLDER/scheduler.json" ]; do
    [ -n "$(jobs -pr)" ] || {{ cat "$FOLDER"/*.log >&2; exit 1; }}
    sleep 0.2
done
ADDRESS=$("$PYTHON" -c 'import json, sys; print(json.load(open(sys.argv[1]))["address"])' "$FOLDER/scheduler.json")
if [ $# -gt 0 ]; then
    # behind: bash would run the traps only after a command in front has ended
    "$PYTHON" -m bakery "$@" --cluster "$ADDRESS" <&0 &
    wait $!
else
    echo "bake RECIPE… --cluster $ADDRESS"
    wait
fi
"""
CALLS = {"local": "bash cluster.sh", "slurm": "sbatch cluster.sh"}


def script(kind: str, workers: int, memory: float, time: str = "") -> str:
    """The text of a bash script.

    kind : "local" or "slurm"
    workers : processes of one thread each
    memory : bytes of each of them
    time : after which Slurm ends the job, `H:MM:SS`
    """
    root = Path(bakery.__file__).resolve().parents[1]
    # an installed package is found anyway; one that runs from its sources is not
    path = "" if "site-packages" in root.parts else f'export PYTHONPATH={shlex.quote(str(root))}"${{PYTHONPATH:+:$PYTHONPATH}}"\n'
    numbers = {"workers": workers, "tasks": workers + 1, "memory": math.ceil(memory / 1e6), "time": time}
    return _SCRIPT.format(
        head=_SLURM.format(**numbers) if kind == "slurm" else "", version=bakery.__version__, call=CALLS[kind], path=path,
        python=shlex.quote(sys.executable), start=_START[kind].format(**numbers), workers=workers,
        folder="${SLURM_SUBMIT_DIR:-$PWD}" if kind == "slurm" else "${TMPDIR:-/tmp}")
