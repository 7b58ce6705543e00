"""A room that no house has: the whole of a small stage, as docs/architecture.md says that one is added."""
