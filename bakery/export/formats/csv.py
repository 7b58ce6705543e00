"""Every table of an asset as CSV."""

from bakery.export.declaration import Exporter, Job, Written


def write(job: Job) -> Written:
    from bakery.export.csv import csv_files

    files = {f"{job.stem}_{name}": text for name, text in csv_files(job.asset.tree).items()}
    return Written(files, [], ["nothing is lost: every number has all its digits; provenance stays in the asset"])


EXPORTER = Exporter("csv", "every table, units in the headings", "anything", (), "every number", "provenance", write)
