"""Frames that have to be rendered: one after the other, or many at a time on the workers of a cluster."""

import time
from collections.abc import Iterator

from bakery.store.put import put_all
from renderers.cluster import files
from renderers.cluster.passes import workers
from renderers.sequence import far
from renderers.sequence.frame import drawn, row_of
from renderers.sequence.prepared import variant_of


def one_by_one(sequence, frames, resume, progress, cluster) -> Iterator[tuple[int, dict]]:
    """(number, row of the report) of each frame, one after the other; arguments as of `renderers.sequence.render`.

    Workers of a cluster share the passes of each frame, where its renderer goes by passes.
    """
    for position, frame in enumerate(frames):
        progress.stage(f"frame {frame.number}", f"{position + 1} of {len(frames)}", 0.0, 0.0)
        began = time.monotonic()
        options = frame.options | {"overwrite": sequence.overwrite}
        options |= {"elsewhere": workers(cluster)} if cluster is not None and frame.scene.rules.RESUMES else {}
        report, resumed = drawn(frame.scene, frame.pair[0], options,
                                resume and frame.pair[1].is_file(), progress.update)
        yield frame.number, row_of(frame, report, "resumed" if resumed else "rendered", time.monotonic() - began)


def on_cluster(sequence, frames, resume, progress, cluster) -> Iterator[tuple[int, dict]]:
    """The same, a frame a worker of a `bakery.run.dask.Cluster`: pictures come back as bytes, and are written here."""
    if not frames:
        return
    common, besides = far.bundles(frames)
    progress.stage(f"{len(frames)} frames", "on the cluster", 0.0, 0.0)
    tasks = [far.Task(frame.number, files.Sent.of(frame.scene, sequence.settings), _options(frame),
                      frame.pair[1].read_bytes() if resume and frame.pair[1].is_file() else None) for frame in frames]
    finished = 0
    for position, answer in cluster.arriving(far.rendered, [common] * len(frames), besides, tasks):
        frame, finished = frames[position], finished + 1
        put_all(dict(zip(frame.pair, answer.pictures)))
        progress.update(finished / len(frames), None, f"{finished} of {len(frames)}")
        yield frame.number, row_of(frame, answer.figures, "resumed" if answer.resumed else "rendered", answer.seconds)


def _options(frame) -> dict:
    """As the renderer takes them, with the variant that would render here: another one has other bytes.  Filters take none."""
    return frame.options | ({"variant": variant_of(frame.options["variant"])} if frame.scene.rules.RESUMES else {})
