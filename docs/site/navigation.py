"""The site's navigation: groups and order are those of docs/index.md, which stays a page like the others."""

from __future__ import annotations

import posixpath
import re

LINK = re.compile(r"\]\(([^)#\s]+)\.md(?:#[^)]*)?\)")


def toctrees(index: str, root: str, folder: str = "docs") -> str:
    """Directives for each heading of the index, with the pages that are linked below it; each page once, `root` not.

    The index itself stands first.
    """
    seen, found = {root}, []
    for group in re.split(r"^## ", index, flags=re.MULTILINE)[1:]:
        heading, _, text = group.partition("\n")
        pages = [posixpath.normpath(posixpath.join(folder, target)) for target in LINK.findall(text) if "://" not in target]
        fresh = [page for page in dict.fromkeys(pages) if page not in seen]
        seen.update(fresh)
        fresh[:0] = [] if found else [f"{folder}/index"]
        found.append("\n".join(["```{toctree}", ":hidden:", f":caption: {heading}", "", *(f"/{page}" for page in fresh), "```"]))
    return "\n\n".join(found)
