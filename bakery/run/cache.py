"""The cache of finished stages: a folder of small assets, each named by the hash of its inputs.

An entry is written whole or not at all, carries its own key and hashes, and is checked when it is read; a bad one is moved aside
and computed again.  Files that are no entries (`bakery.run.entries`) are never touched, whatever their name.  Nothing here is
needed: a cache that cannot be written costs one warning and the time to compute again.
Where machines share entries (`bakery.run.shared`), this folder is the local layer in front of them.
"""

import errno
import json
import math
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from bakery.errors import AssetError, StoreError, UsageError
from bakery.run.entries import BAD, ENTRY, LOCKS, SCENES, SPEED, Held, held, is_entry, is_stage, key_of_asset
from bakery.run.shared import Shared, is_shared
from bakery.store.put import put
from bakery.store.tree import Group

KEEP = 16  # bakes kept of a kind of work
SHORT = 12  # digits of an input hash that distinguish bakes there
SMALL = 0.3  # modelled seconds up to which a bake says nothing of the machine
OWN = 0.5  # weight of the model among bakes


def places() -> tuple[Path, str | None]:
    """The folder of the cache, the user's own by default, and the address of what is shared behind it; BAKERY_CACHE is either.

    Raises UsageError where it names a file, or a folder that cannot be made because a file is in its way.
    """
    chosen = os.environ.get("BAKERY_CACHE")
    if chosen and not is_shared(chosen):
        folder = Path(chosen).absolute()
        _refuse_name(folder, f'BAKERY_CACHE: found "{chosen}"')
        stands = next(path for path in (folder, *folder.parents) if path == path.parent or os.path.lexists(path))
        if not os.path.isdir(stands):
            raise UsageError(f'BAKERY_CACHE: found "{chosen}", but {stands} is no folder; '
                             "expected a folder, there or to be made")
        return folder, None
    from platformdirs import user_cache_path

    default = user_cache_path("bakery")
    _refuse_name(default, f'found the cache folder "{default}"')
    return default, None if chosen and Path(chosen).absolute() == default else chosen or None


def _refuse_name(folder: Path, message: str) -> None:
    """UsageError where no folder can have such a name."""
    try:
        os.lstat(folder)
    except OSError as error:
        if error.errno in (errno.ENAMETOOLONG, errno.ELOOP):
            raise UsageError(f"{message}, which cannot be a folder ({error.strerror}); use another one") from None
    except ValueError:
        raise UsageError(f"{message}, which cannot be the name of a folder; use another one") from None


def _median(votes: list[tuple[float, float]]) -> float:
    """Weighted median of (value, weight)."""
    half = 0.5 * sum(weight for _, weight in votes)
    for value, weight in sorted(votes):
        half -= weight
        if half <= 0:
            return value
    raise ValueError("no votes")


class _Foreign(Exception):
    """A sound asset, which is no entry of a cache."""


def _checked(shown: str, data: bytes, name: str, key: str) -> tuple[Group, Group]:
    """The group and the provenance of an entry; _Foreign where it is a whole asset, AssetError where it is damaged or that of
    another key."""
    from bakery.store.read import parse

    root = parse(shown, data)
    if not is_stage(root):
        raise _Foreign
    if root.attributes["name"] != name or root[name].attributes.get("input_hash") != key:
        raise AssetError(f"{shown}: the entry holds other inputs than its name says")
    return root[name], root["provenance"]


class Cache:
    """Finished stages by (name, input hash).

    where : the folder, made when the first entry is written, of a cache that is not shared; BAKERY_CACHE by default
    say : takes remarks for the user

    Raises UsageError : BAKERY_CACHE names what is no place for a cache
    """

    def __init__(self, where: Path | None = None, say: Callable[[str], None] = lambda text: None):
        self.where, address = (where, None) if where else places()
        self.shared = Shared(address, self.where, say) if address else None
        self._say = say
        self._writable = True
        self._instead = "fetched or computed again" if self.shared else "computed again"

    def path(self, name: str, key: str) -> Path:
        """The file of an entry."""
        return self.where / f"{name}-{key}{ENTRY}"

    def has(self, name: str, key: str) -> bool:
        """Whether there is an entry, without a look inside."""
        path = self.path(name, key)
        return path.is_file() or (self.shared is not None and self.shared.has(path.name))

    def get(self, name: str, key: str) -> tuple[Group, Group] | None:
        """The stage's group and its provenance, or None.  A damaged or misnamed entry is told and counts as none."""
        return self._own(name, key) or (self._others(name, key) if self.shared else None)

    def _own(self, name: str, key: str) -> tuple[Group, Group] | None:
        """An entry of the folder."""
        from bakery.store.read import read_bytes

        path = self.path(name, key)
        if not path.is_file():
            return None
        try:
            entry = _checked(os.fspath(path), read_bytes(os.fspath(path)), name, key)
        except _Foreign:
            self._say(f"cache: {path.name} is an asset and no entry of the cache; left as it is, and {self._instead}")
            return None
        except AssetError as error:
            self._set_aside(path, error)
            return None
        except (StoreError, OSError) as error:
            self._say(f"cache: {path.name} could not be read ({error}); {self._instead}")
            return None
        try:
            os.utime(path)  # the least recently used entries are the first that `cache prune` takes
        except OSError:
            pass
        return entry

    def _others(self, name: str, key: str) -> tuple[Group, Group] | None:
        """An entry of the machines that share; a copy stays in the folder."""
        path = self.path(name, key)
        data = self.shared.fetch(path.name)
        if data is None:
            return None
        shown = f"{self.shared.address}/{path.name}"
        try:
            entry = _checked(shown, data, name, key)
        except (AssetError, _Foreign) as error:
            reason = error if isinstance(error, AssetError) else f"{shown} is no entry of a cache"
            self._say(f"cache: {reason}; computed again and replaced")
            return None
        self._keep(path, data)
        return entry

    # whole assets, of scenes that name recipes

    def asset_path(self, name: str, key: str) -> Path:
        """The file of a whole asset, of a key by `bakery.run.entries.asset_key`."""
        return self.where / SCENES / f"{name}-{key}{ENTRY}"

    def asset(self, path: Path) -> Group | None:
        """What such a file holds; None unless it is sound and what its name says."""
        from bakery.store.read import read

        try:
            root = read(path)
        except (AssetError, StoreError):
            return None
        if path.name != self.asset_path(root.attributes["name"], key_of_asset(root)).name:
            return None
        with suppress(OSError):
            os.utime(path)
        return root

    def _set_aside(self, path: Path, error: AssetError) -> None:
        reason = str(error).removeprefix(f"{path}: ")
        try:
            os.replace(path, path.with_suffix(BAD))
            self._say(f"cache: {path.name}: {reason}; moved aside and {self._instead}")
        except OSError:
            self._say(f"cache: {path.name}: {reason}; {self._instead}")

    def put(self, name: str, key: str, group: Group, provenance: Group) -> None:
        """Keep a finished stage; a failure is one warning, not the end of the bake."""
        from bakery.store.hashes import seal
        from bakery.store.image import image

        if not self._writable and not self.shared:
            return
        data = image(seal(Group({name: group, "provenance": provenance}, {"name": name})))
        self._keep(self.path(name, key), data)
        if self.shared:
            self.shared.keep(self.path(name, key).name, data)

    def _keep(self, path: Path, data: bytes) -> None:
        """Put the bytes of an entry into the folder; never over a file that is none."""
        from bakery.store.write import place

        if not self._writable or os.path.lexists(path) and not is_entry(path):
            return
        try:
            self.where.mkdir(parents=True, exist_ok=True)
            place(path, data)
        except (StoreError, OSError, UsageError) as error:
            self._writable = False
            reason = error.strerror or error if isinstance(error, OSError) else error
            self._say(f"cache: not written ({reason}); the bake goes on without it")

    @contextmanager
    def lock(self, name: str, key: str) -> Iterator[None]:
        """Hold a stage while it is computed, so that two bakes at once compute it once.

        The lock is the kernel's: it ends with its holder, however that ends.
        """
        from filelock import FileLock, Timeout

        try:
            (self.where / LOCKS).mkdir(parents=True, exist_ok=True)
            lock = FileLock(self.where / LOCKS / f"{name}-{key}.lock")
            try:
                lock.acquire(timeout=0.2)
            except Timeout:
                self._say(f"{name}: another bake computes it; waiting")
                lock.acquire()
        except (OSError, NotImplementedError):
            yield  # no lock to be had here: at worst the stage is computed twice
            return
        try:
            yield
        finally:
            lock.release()

    # what stages took on this machine

    def speed(self, kind: str, key: str, work: float) -> tuple[float, int]:
        """Time on this machine over the modelled time, and how many bakes say so (0: none, the model alone counts).

        key : the stage's input hash
        work : modelled seconds

        The same inputs take what they took.  Else the median of what is known of the kind: amounts of work that are alike count
        most, since models err differently where little and where much is done.  The model, at the speed that this machine shows
        in other kinds of work, counts as half a bake.
        """
        speeds = self._speeds()
        measured = speeds.get(kind, [])
        for past_key, past_work, seconds in measured:
            if past_key == key[:SHORT]:
                return seconds / past_work, 1
        # two votes for the models' own machine: it takes three kinds of work to be believed slower or faster
        large = ([(seconds / past_work, 1.0) for _, past_work, seconds in entries if past_work > SMALL]
                 for entries in speeds.values())
        machine = _median([(1.0, 2.0), *((_median(votes), 1.0) for votes in large if votes)])
        near = [(seconds / past_work, 1 / (1 + math.log(work / past_work) ** 2)) for _, past_work, seconds in measured]
        return _median([(machine, OWN), *near]), len(measured)

    def note_speed(self, kind: str, key: str, work: float, seconds: float) -> None:
        """Remember how long a stage took whose modelled time is `work`."""
        speeds = self._speeds()
        measured = [entry for entry in speeds.get(kind, []) if entry[0] != key[:SHORT]]
        speeds[kind] = (measured + [(key[:SHORT], work, max(seconds, 1e-3))])[-KEEP:]
        with suppress(StoreError, UsageError):  # only the next plan's estimate is poorer
            put(self.where / SPEED, json.dumps(speeds))

    def _speeds(self) -> dict[str, list[tuple[str, float, float]]]:
        try:
            speeds = json.loads((self.where / SPEED).read_text())
            return {str(kind): [(str(key), float(work), float(seconds)) for key, work, seconds in entries
                                if 0 < work < 1e9 and 0 < seconds < 1e9] for kind, entries in speeds.items()}
        except (OSError, ValueError, AttributeError, TypeError, RecursionError):
            return {}

    # tidying

    def sweep(self) -> None:
        """Remove the half-written files of killed bakes."""
        from bakery.store.write import sweep

        for folder in (self.where, self.where / SCENES):
            sweep(os.fspath(folder))

    def held(self) -> Held:
        """Entries, what was set aside, and what lies in the folder and is no cache's; looks into each file."""
        return held(self.where)

    def entries(self) -> list[tuple[Path, int, float]]:
        """Path, size and time of last use of each entry, oldest first."""
        return self.held().entries

    def prune(self, max_bytes: float | None = None, max_age: float | None = None) -> list[Path]:
        """Remove entries by age in seconds, then the least recently used down to a size in bytes, and what was set aside."""
        removed, held = [], self.held()
        total = sum(size for _, size, _ in held.entries)
        now = time.time()
        for path, size, used in held.entries:
            if (max_age is not None and now - used > max_age) or (max_bytes is not None and total > max_bytes):
                if self._remove(path):
                    removed.append(path)
                total -= size
        return removed + [path for path in held.bad if self._remove(path)]

    def clear(self) -> list[Path]:
        """Remove every entry, and nothing else.  A bake that is reading one goes on: the file lives until it is closed."""
        held = self.held()
        return [path for path in (*(path for path, _, _ in held.entries), *held.bad) if self._remove(path)]

    def _remove(self, path: Path) -> bool:
        try:
            path.unlink()
        except FileNotFoundError:
            return False
        except OSError as error:
            raise StoreError(f"{path}: could not be removed ({error.strerror})") from error
        return True
