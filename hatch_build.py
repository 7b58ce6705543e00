"""Puts man pages into the wheel where `make man` has made them: what they are made of is not installed while a wheel is built."""

from pathlib import Path

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class ManPages(BuildHookInterface):
    def initialize(self, version, build_data):
        for page in sorted(Path(self.root, "build/man/man1").glob("*.1")):
            build_data["shared_data"][str(page)] = f"share/man/man1/{page.name}"
