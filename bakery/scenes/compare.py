"""A scene by several methods, beside one another on one page: what `bake compare` does."""

from pathlib import Path

from bakery.draw.files import folder_filled
from bakery.errors import UsageError
from bakery.report import comparison as report
from bakery.scenes import methods
from bakery.store.put import put
from bakery.trade import methods as trade
from renderers.pictures import comparison, differences
from renderers.scene import load
from renderers.scene.budget import DEFAULT


def planned(source, names, reference, output, values, seed, resume, overwrite):
    """Jobs, the page, and the reference where it is a file; everything that can be wrong before work is said here."""
    named = methods.split(names)
    file = Path(reference) if reference and reference.lower().endswith(".exr") else None
    if reference and file is None and reference not in named:
        named.insert(0, reference)
    if file is not None and not file.is_file():
        raise UsageError(f'--reference: found "{reference}", and there is no such file')
    if len(named) + (file is not None) < 2:
        raise UsageError(f"--methods: found {len(named) or 'none'}; expected two or more, or a --reference")
    loaded = load(source, values)
    page = methods.page_at(output, loaded, "compare")
    if resume and not loaded.rules.RESUMES:
        raise UsageError(f"--resume: the renderer {loaded.section} cannot go on from an EXR; leave the option out")
    jobs = comparison.jobs(source, named, page.with_suffix(""), values, seed)
    methods.check(page, jobs, [*loaded.inputs, *([file] if file else [])], overwrite)
    return jobs, page, file


def compared(jobs, page, reference, file, progress, **options) -> dict:
    """Renders, measures and writes; what `--json` prints."""
    reference_picture = None if file is None else differences.read(file, file.name)
    renders, pictures = [], []
    with folder_filled(page.with_suffix("")):
        for job in jobs:
            renders.append(methods.made(job, progress, comparison.render, **options))
            pictures.append(differences.read(job.pair[1], job.name))
            differences.same_size(pictures[-1], reference_picture or pictures[0], file or jobs[0].name)
    base = reference_picture or next(picture for picture in pictures if picture.name == reference)
    with progress.during("measuring differences"):
        seen = differences.compared([*([reference_picture] if reference_picture else []), *pictures], base,
                                    dict(jobs[0].scene.values.display))
        summary = methods.summary(renders, seen, base, file)
        for method, its in zip(summary["methods"], renders, strict=True):
            method["missed"] = its.report.get("missed", [])  # none of an earlier version's record
        curves = methods.curves(summary)
        summary["trade"] = trade.compared(curves, jobs[0].scene.values.tolerance or DEFAULT) if curves else None
        shown, limit = methods.shown(seen)
        text = report.page(summary, shown, limit, methods.drawing(curves, summary["trade"]["knee"]) if curves else None)
    put(page, text)
    return summary | {"page": str(page), "bytes": len(text.encode())}
