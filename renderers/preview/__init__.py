"""The standard preview of an asset: `preview(asset, output)` renders it, `describe(report)` says how, in lines for people."""

from renderers.preview.picture import preview
from renderers.preview.report import describe

__all__ = ["describe", "preview"]
