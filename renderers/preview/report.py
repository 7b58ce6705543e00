"""What a render reports, in lines for people."""

from __future__ import annotations

from renderers.preview.lobe import length


def describe(report) -> list[str]:
    """Lines for the report of `preview` or `render_scene`."""
    several = len(report.get("panels", ())) > 1
    noise = f"noise {100 * report['noise']:.2g} %"
    if "noise_shown" in report:
        noise += f", {100 * report['noise_shown']:.2g} % in the filtered PNG"
    stopped = {"noise": "the noise wanted was reached", "samples": "all samples were taken",
               "time": "the time limit was reached, so the picture depends on the machine"}[report["stopped_by"]]
    lines = [f"pictures: {', '.join(report['files'])}",
             f"variant: {report['variant']} ({report['reason']})",
             f"samples: {report['samples']} a pixel and wavelength in {report['seconds']:.1f} s; {noise}; {stopped}"]
    if several:
        lines.append("panels: " + "; ".join(f"{panel['shows']}, {panel['samples']} samples, noise {100 * panel['noise']:.2g} %, "
                                            f"{100 * panel['noise_shown']:.2g} % filtered" for panel in report["panels"]))
    if "grains" in report:
        left_out = f", {report['grains_left_out']} left out" if report["grains_left_out"] else ""
        lines.append(f"grains: {', '.join(report['grains'])}{left_out}; bounding radius {length(report['grain_radius'])}")
    if "block" in report:
        lines.append(f"block: edge {report['block']}, surface index-matched")
    if report.get("misdirected"):
        lines.append(f"phase function: on a regular grid, which sends {100 * report['misdirected']:.2g} % of the light to "
                     "another angle; llvm and cuda variants use the asset's own table")
    return lines
