"""Sequences: the frames of a scene, a film and a contact sheet of them.

What frames are stands in `renderers.scene.frames`.  Here they are rendered, each whole, by the renderer of the scene; one that is
there and was made of the same is left as it is.
"""

import time
from collections import Counter

from bakery.errors import Interrupted, UsageError
from bakery.run.progress import Progress
from bakery.system.signals import Terminated


def render(path, output=None, numbers=None, *, overrides=None, options=None, overwrite=False, resume=False, progress=None,
           cluster=None) -> dict:
    """Renders frames of a scene, each to a PNG and an EXR file, and a film and a contact sheet where they are several.

    Parameters
    ----------
    path : of the scene, which has a section `frames`
    output : `X.png` or `X.exr`, frames are `X.0001.png` …; beside the scene, by its name, if None
    numbers : of the frames, ascending (`renderers.scene.frames.numbers`); all if None
    overrides, overwrite : as renderers take them
    options : dict of `quality`, `variant` and `seed`, where they are given, as renderers take them
    resume : go on with the passes of frames that are not finished
    progress : `bakery.run.progress.Progress`, or None
    cluster : `bakery.run.dask.Cluster` whose workers render frames, or passes where frames are fewer than workers; None: this
        process does

    Returns
    -------
    report : dict with `scene`, `frames` (of each `frame`, `status` rendered, resumed or kept, `files`, `method`, `samples`,
        `noise`, `denoised`, `missed`, `seconds`), `film` and `sheet` (path, or None), `noise` (same or fresh random numbers),
        `remarks`, `missed` (of the film), `seconds`

    Raises
    ------
    RecipeError, UsageError : with every problem of all frames, before anything is rendered
    Interrupted : frames that are finished stay
    BakeryError : as the renderer
    """
    from renderers.sequence import film, prepared, sheet

    begin, progress = time.monotonic(), progress or Progress()
    sequence = prepared.of(path, output, numbers, overrides=overrides, options=options or {}, overwrite=overwrite,
                           progress=progress)
    first = sequence.frames[0].scene
    if resume and not first.rules.RESUMES:
        raise UsageError(f"--resume: the renderer {first.section} cannot go on from an EXR; leave the option out")
    done: dict[int, dict] = {}
    try:
        for number, row in _rows(sequence, resume, progress, cluster):
            done[number] = row
    except (Interrupted, KeyboardInterrupt, Terminated) as stop:
        raise _interrupted(stop, len(done), len(sequence.frames)) from None
    rows = [done[frame.number] for frame in sequence.frames]
    remarks, missed = [*sequence.remarks, *_uneven(rows)], []
    written = dict.fromkeys(("film", "sheet"))
    if len(rows) > 1:
        pictures = [frame.pair[0] for frame in sequence.frames]
        names = prepared.beside(sequence.output)
        with progress.during("film and contact sheet"):
            written["sheet"] = sheet.write(names["sheet"], pictures, [frame.number for frame in sequence.frames])
            written["film"], words = film.write(names["film"], pictures, sequence.rate)
        (missed if film.program() else remarks).extend(words)
    return {"scene": str(sequence.path), "frames": rows, **written, "rate": sequence.rate, "noise": sequence.noise,
            "remarks": remarks, "missed": missed, "seconds": time.monotonic() - begin}


def files(report) -> list[str]:
    """Every file that a report speaks of."""
    return [*(file for row in report["frames"] for file in row["files"]), *filter(None, (report["film"], report["sheet"]))]


def describe(report) -> list[str]:
    """Lines for people."""
    from renderers.scene.budget import percent

    rows = report["frames"]
    counts = Counter(row["status"] for row in rows)
    statuses = ", ".join(f"{counts[status]} {words}" for status, words in
                         (("rendered", "rendered"), ("resumed", "gone on with"), ("kept", "left as they are")) if counts[status])
    noises = [row["noise"] for row in rows if row["noise"] is not None]
    noise = f"; noise {' to '.join(dict.fromkeys((percent(min(noises)), percent(max(noises)))))}" if noises else ""
    shown = [f"film: {report['film']}, {report['rate']:g} frames a second"] if report["film"] else []
    return [f"{len(rows)} frame{'s' * (len(rows) > 1)}: {statuses}{noise}", *shown,
            *([f"contact sheet: {report['sheet']}"] if report["sheet"] else []), *report["remarks"],
            f"time: {report['seconds']:.1f} s"]


def _rows(sequence, resume, progress, cluster):
    """(number, row of the report) of each frame, as they are finished."""
    from renderers.sequence import rendered
    from renderers.sequence.frame import kept

    due = []
    for frame in sequence.frames:
        row = kept(frame)
        if row is None:
            due.append(frame)
        else:
            yield frame.number, row
    # frames travel less than their passes do, but few frames leave workers without work
    shared = cluster is not None and len(due) >= sum(cluster.threads.values())
    draw = rendered.on_cluster if shared else rendered.one_by_one
    yield from draw(sequence, due, resume, progress, cluster)


def _interrupted(stop, finished, count):
    """What to raise where a signal ended the frames."""
    how_far = f"{stop}; " if isinstance(stop, Interrupted) else "interrupted; "
    status = stop.exit_status if isinstance(stop, Interrupted) else 143 if isinstance(stop, Terminated) else 130
    return Interrupted(f"{how_far}{finished} of {count} frames are finished, and the same call renders the others").ending(status)


def _uneven(rows) -> list[str]:
    """What will be seen as a jump from frame to frame."""
    without = [row["frame"] for row in rows if not row["denoised"]]
    if not without or len(without) == len(rows):
        return []
    return [f"frame {', '.join(map(str, without[:5]))}{' …' * (len(without) > 5)}: the noise is not taken out, as of the others: "
            "--denoise or --no-denoise would do the same with all"]
