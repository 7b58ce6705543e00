"""Sources of compiled kernels: a hash of a file and of all that it imports of these packages."""

import hashlib
import os
import re
from functools import cache
from pathlib import Path

PACKAGES = ("bakery", "renderers")


def stamp(file: Path) -> str:
    """Hash of the contents of a file of a package and of all that it imports of the package's neighbours in `PACKAGES`."""
    digest = hashlib.sha256()
    for source in sorted(with_imports(file), key=str):
        digest.update(_content(source)[0])
    return digest.hexdigest()


def kept(file: Path, function: str) -> bool:
    """Whether this machine keeps kernels of a function of a file as it stands; says so without loading numba."""
    from platformdirs import user_cache_path

    setting = os.environ.get("NUMBA_CACHE_DIR")
    # numba keeps them beside the source, or for the user where that cannot be written; the index has the stamp in it
    for root in [Path(setting)] if setting else [file.parent / "__pycache__", user_cache_path("numba", appauthor=False)]:
        folders = [root] if root.name == "__pycache__" else root.glob(f"{file.parent.name}_*")
        for folder in folders:
            if any(stamp(file).encode() in path.read_bytes() for path in folder.glob(f"{file.stem}.{function}-*.nbi")):
                return True
    return False


def with_imports(file: Path) -> set[Path]:
    """A file and those that it imports, directly or not."""
    sources, waiting = set(), [file]
    while waiting:
        source = waiting.pop()
        if source not in sources:
            sources.add(source)
            waiting += _content(source)[1]
    return sources


# `from MODULE import NAMES` and `import NAMES`, NAMES in brackets or over lines that end in a backslash.  By their text: to parse
# all files took 0.2 s of every process that calls a kernel.  An import inside of a text makes a stamp of more than it needs
_NAMES = r"(\([^)]*\)|(?:\\\n|[^\n])*)"
_IMPORT = re.compile(rf"^(?:from[ \t]+(\S+)[ \t]+)?import[ \t]+{_NAMES}", re.MULTILINE)
_NO_NAMES = re.compile(r"#[^\n]*|[()\\]")


@cache
def _content(file: Path) -> tuple[bytes, list[Path]]:
    """Hash of a file, and the files that it imports by itself, at its top: what functions import is nothing that kernels see."""
    code, root = file.read_bytes(), _root(file)
    names = []
    for module, imported in _IMPORT.findall(code.decode()):
        listed = [item.split()[0] for item in _NO_NAMES.sub("", imported).split(",") if item.strip()]
        if not module:
            names += listed
        elif not module.startswith("."):  # neighbours import each other by their whole names
            modules = [f"{module}.{name}" for name in listed]
            names += [name if _module(root, name) else module for name in modules]
    packages = (*PACKAGES, package(file))
    dependencies = [_module(root, name) for name in dict.fromkeys(names) if name.split(".")[0] in packages]
    return hashlib.sha256(code).digest(), [dependency for dependency in dependencies if dependency]


def _module(root: Path, name: str) -> Path | None:
    """The file of a module or a package, or None."""
    path = root.joinpath(*name.split("."))
    return next((file for file in (path.with_name(f"{path.name}.py"), path / "__init__.py") if file.is_file()), None)


def _root(file: Path) -> Path:
    """The folder of the outermost package that a file is in."""
    folder = file.parent
    while (folder / "__init__.py").is_file():
        folder = folder.parent
    return folder


def package(file: Path) -> str:
    """The name of that package; of a file in none, its own."""
    return file.relative_to(_root(file)).parts[0]
