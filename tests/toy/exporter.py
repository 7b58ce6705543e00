"""A small exporter: the medium's albedo as one line of text."""

from bakery.errors import UsageError
from bakery.export.declaration import Exporter, Job, Option, Written
from bakery.store.outputs import FileKind


def _digits(text: str) -> int:
    if not text.isdecimal():
        raise UsageError(f'--digits: found "{text}"; expected a number such as 3')
    return int(text)


DIGITS = Option("--digits", "of each number.", "N", _digits)


def write(job: Job) -> Written:
    digits = job.settings.get(DIGITS.name, 6)
    albedo = job.asset.medium.albedo
    text = " ".join(f"{value:.{digits}g}" for value in albedo)
    return Written({f"{job.stem}.note": text}, [{"digits": digits}], ["all but the albedo is lost"], ["a note is no medium"])


EXPORTER = Exporter("note", "the albedo in a line of text", "people", ("medium",), "the albedo", "all else", write, (DIGITS,),
                    {".note": FileKind("note", lambda head: b"\0" not in head)})
