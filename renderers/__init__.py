"""Renderers: each a thin folder that takes assets through `bakery.open` and makes pictures."""
