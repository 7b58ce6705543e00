"""A complete small stage, added as docs/architecture.md describes."""
