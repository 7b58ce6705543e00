"""What a render with Mitsuba reports, in lines for people."""

STOPPED = {"noise": "the noise wanted was reached", "samples": "all samples were taken",
           "time": "the time limit was reached, so the picture depends on the machine"}


def describe(report) -> list[str]:
    """Lines for a report with `files`, `variant`, `reason`, `samples`, `seconds`, `noise` and `stopped_by`, such as that of
    `render_scene`; `noise_shown`, if it is there, is that of the filtered PNG, and `noise_of` the file whose noise stops the
    passes."""
    noise = f"noise {100 * report['noise']:.2g} %"
    if "noise_shown" in report:
        noise += f", {100 * report['noise_shown']:.2g} % in the filtered PNG"
    of = f" in the {report['noise_of']}" if report["stopped_by"] == "noise" and "noise_of" in report else ""
    return [f"pictures: {', '.join(report['files'])}",
            f"variant: {report['variant']} ({report['reason']})",
            f"samples: {report['samples']} a pixel and wavelength in {report['seconds']:.1f} s; {noise}; "
            f"{STOPPED[report['stopped_by']]}{of}", *report.get("reasons", [])]
