"""`bake render SCENE --frames NUMBERS`: frames of a sequence, a film and a contact sheet."""

from contextlib import nullcontext
from pathlib import Path

from bakery.cli.options import print_json, print_paths, status_of_missed
from bakery.errors import UsageError


def rendered(source, frames, address, options, as_json, quiet) -> int:
    """Renders frames with `options` of `renderers.sequence.render`, prints, and gives the exit status."""
    from bakery.run import compiling, dask
    from bakery.run.progress import choose
    from bakery.system.terminal import warned
    from renderers import sequence
    from renderers.scene.frames import numbers

    if Path(source).suffix.lower() not in (".yaml", ".yml"):
        raise UsageError(f"--frames: {source} is no scene (.yaml); only scenes have frames")
    asked = numbers(frames)
    progress = choose(quiet)
    try:
        workers = nullcontext() if address is None else dask.cluster(address, progress.say)
        with workers as cluster, warned(progress.say), compiling.watched(("renderers",), progress.compiling):
            report = sequence.render(source, numbers=asked, progress=progress, cluster=cluster, **options)
    finally:
        progress.close()
    if as_json:
        print_json(report)
    else:
        print_paths(sequence.files(report))
        for line in sequence.describe(report):
            progress.say(line)
    missed = [status_of_missed(row["files"][0], row["missed"]) for row in report["frames"]]
    return max(*missed, status_of_missed(report["scene"], report["missed"]))
