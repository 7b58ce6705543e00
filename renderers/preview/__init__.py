"""The standard preview of an asset: `preview(asset, output)` renders it, `describe(report)` says how, in lines for people."""

from renderers.preview.picture import describe, preview

__all__ = ["describe", "preview"]
