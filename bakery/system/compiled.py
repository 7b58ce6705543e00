"""`njit` of numba, whose kept kernels are those of all the sources that they were compiled from.

numba keeps a kernel for as long as its own file stays as it is.  What the kernel calls, and constants that it uses, may stand in
other files; so the stamp of ours is a hash of the file and of every module of these packages that it imports, directly or not.
"""

from __future__ import annotations

import ast
import hashlib
from functools import cache
from pathlib import Path

from numba import njit
from numba.core import caching

__all__ = ["njit"]

_PACKAGES = ("bakery", "renderers")


class _BySources:
    """Of a numba locator, which says where a kernel is kept and by which stamp: that of all its sources."""

    @classmethod
    def from_function(cls, py_func, py_file):
        return super().from_function(py_func, py_file) if _package(Path(py_file)) in _PACKAGES else None

    def get_source_stamp(self):
        return stamp(Path(self._py_file))


def stamp(file: Path) -> str:
    """Hash of the contents of a file of a package and of all that it imports of the package's neighbours in `_PACKAGES`."""
    digest = hashlib.sha256()
    for source in sorted(_with_imports(file), key=str):
        digest.update(_content(source)[0])
    return digest.hexdigest()


def _with_imports(file: Path) -> set[Path]:
    """A file and those that it imports, directly or not."""
    sources, waiting = set(), [file]
    while waiting:
        source = waiting.pop()
        if source not in sources:
            sources.add(source)
            waiting += _content(source)[1]
    return sources


@cache
def _content(file: Path) -> tuple[bytes, list[Path]]:
    """Hash of a file, and the files that it imports by itself, at its top: what functions import is nothing that kernels see."""
    code, root = file.read_bytes(), _root(file)
    names = []
    for node in ast.parse(code).body:
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and not node.level:  # neighbours import each other by their whole names
            modules = [f"{node.module}.{alias.name}" for alias in node.names]
            names += [module if _module(root, module) else node.module for module in modules]
    packages = (*_PACKAGES, _package(file))
    found = [_module(root, name) for name in dict.fromkeys(names) if name.split(".")[0] in packages]
    return hashlib.sha256(code).digest(), [module for module in found if module]


def _module(root: Path, name: str) -> Path | None:
    """The file of a module or a package, or None."""
    folder = root.joinpath(*name.split("."))
    return next((file for file in (folder.with_name(f"{folder.name}.py"), folder / "__init__.py") if file.is_file()), None)


def _root(file: Path) -> Path:
    """The folder of the outermost package that a file is in."""
    folder = file.parent
    while (folder / "__init__.py").is_file():
        folder = folder.parent
    return folder


def _package(file: Path) -> str:
    """The name of that package; of a file in none, its own."""
    return file.relative_to(_root(file)).parts[0]


def _register():
    """Puts ours before numba's own, of which each tries another folder: the user's, the source's, one in the home folder."""
    caching.CacheImpl._locator_classes[:0] = [type(f"BySources{theirs.__name__}", (_BySources, theirs), {})
                                              for theirs in caching.CacheImpl._locator_classes[:3]]


_register()
