"""What Sphinx makes the site of: README and docs/ as they are, whose links hold on a forge as well (`make site`)."""

from __future__ import annotations

import hashlib
import os
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from docutils import nodes
from sphinx.addnodes import download_reference, pending_xref

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(Path(__file__).parent)]
# notebooks call `bake`, and show what it says to somebody who has baked nothing yet
os.environ["PATH"] = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
CACHE = TemporaryDirectory(prefix="bakery-site-")
os.environ["BAKERY_CACHE"] = CACHE.name

import docstrings  # noqa: E402
import myst_nb.core.render  # noqa: E402
import navigation  # noqa: E402

import bakery  # noqa: E402


def whole_streams(outputs):
    """What a cell has printed, one text a stream: cells of shell commands print pieces of 100 bytes.

    myst-nb's own function puts each piece on a line of its own.
    """
    found, streams = [], {}
    for output in outputs:
        if output["output_type"] != "stream":
            found.append(output)
        elif output["name"] in streams:
            streams[output["name"]]["text"] += output["text"]
        else:
            streams[output["name"]] = output
    return [*(streams[name] for name in sorted(streams, reverse=True)), *found]


myst_nb.core.render.coalesce_streams = whole_streams


def sources() -> str:
    """A digest of all that notebooks run: kept outputs are those of exactly these sources."""
    digest = hashlib.sha256()
    for folder in ("bakery", "renderers", "assets"):
        for path in sorted((ROOT / folder).rglob("*.*")):
            if path.suffix in (".py", ".csv", ".yaml", ".xml"):
                digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


project = "Bakery"
version = release = bakery.__version__
copyright = "the authors of Bakery, BSD-3-Clause"
root_doc = "README"
include_patterns = ["README.md", "CHANGELOG.md", "docs/**.md", "assets/materials/README.md"]
exclude_patterns = [".*", "build", "bakery", "benchmarks", "renderers", "tests", "recipes", "assets/scenes", "assets/schemas"]
extensions = ["myst_nb", "sphinx.ext.autodoc"]
nitpicky = True
default_role = "code"  # `x` in docstrings
autodoc_member_order = "bysource"
autodoc_default_options = {"exclude-members": "__init__, __new__", "special-members": "__call__"}
autodoc_class_signature = "separated"  # classes come from functions, not from their constructors
autodoc_typehints = "none"  # the docstrings say shape and unit

myst_heading_anchors = 4
nb_execution_mode = "cache"
nb_execution_cache_path = str(ROOT / "build" / "notebooks" / sources())
nb_merge_streams = True
nb_execution_in_temp = True
nb_execution_timeout = 300
nb_execution_raise_on_error = True

html_theme = "furo"
html_title = "Bakery"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_extra_path = ["extra"]
html_copy_source = False
html_show_sourcelink = False
html_show_sphinx = False


def with_navigation(app, name, content):
    if name == root_doc:
        content[0] += "\n" + navigation.toctrees((ROOT / "docs/index.md").read_text(encoding="utf-8"), root_doc) + "\n"


def to_sources(app, doctree):
    """What no page is, of what pages link to: files can be downloaded, but not from the table of contents; folders cannot."""
    for title in list(doctree.findall(nodes.title)):
        for link in list(title.findall(download_reference)):
            link.replace_self(link.children)
            name = Path(link["reftarget"]).name
            below = download_reference("", "", nodes.literal("", name), **link.attributes)
            title.parent.insert(1, nodes.paragraph("", "", below))
    folder = (ROOT / app.env.docname).parent
    for link in list(doctree.findall(pending_xref)):
        if link["refdomain"] is None and (folder / link["reftarget"]).is_dir():
            link.replace_self(nodes.literal("", link.astext()))


def docstring(app, what, name, thing, options, lines):
    lines[:] = docstrings.rewritten(lines)


def setup(app):
    app.connect("source-read", with_navigation)
    app.connect("doctree-read", to_sources, priority=100)  # before links and contents are collected
    app.connect("autodoc-process-docstring", docstring)
