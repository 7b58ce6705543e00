"""What a preview reports, in lines for people."""

from renderers.mitsuba.report import describe as describe_render
from renderers.preview.lobe import length


def describe(report) -> list[str]:
    """Lines for the report of `preview`."""
    lines = describe_render(report)
    if len(report["panels"]) > 1:
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
