"""`bake cluster-script slurm|local`: what starts a cluster for `--cluster`."""

import click

from bakery.cli.options import FiniteRange
from bakery.errors import UsageError
from bakery.system.terminal import remark, write

USUAL = {"slurm": 32}  # workers; on this machine one a processor


@click.command(name="cluster-script", short_help="print a script that starts a cluster")
@click.argument("kind", type=click.Choice(["slurm", "local"]), metavar="slurm|local")
@click.option("--workers", type=click.IntRange(1, 100_000), metavar="N",
              help="Worker processes, of one thread each.  [default: slurm 32; local: one a processor]")
@click.option("--memory", type=FiniteRange(0.1, 1e6), default=2.0, show_default=True, metavar="GB", help="Memory of each worker.")
@click.option("--time", metavar="H:MM:SS", help="Time after which Slurm ends the job.  [default: 4:00:00]")
def command(kind, workers, memory, time):
    """Print a bash script that starts a Dask scheduler and workers for `--cluster`: a job of Slurm, or on this machine."""
    import re

    from bakery.run.cluster_script import CALLS, script
    from bakery.system.resources import processors

    if time and kind == "local":
        raise UsageError("--time: only Slurm ends a cluster by itself; leave the option out")
    if time and not re.fullmatch(r"(\d+-)?\d+:\d\d:\d\d", time):
        raise UsageError(f'--time: found "{time}"; expected hours, minutes and seconds (4:00:00), or days too (1-12:00:00)')
    write(script(kind, workers or USUAL.get(kind) or processors(), 1e9 * memory, time or "4:00:00"))
    remark(f"keep it as cluster.sh; `{CALLS[kind]} RECIPE…` bakes on the cluster and ends, `{CALLS[kind]}` alone prints the "
           "command that bakes there" + (" into bakery-JOB.log" if kind == "slurm" else ""))
