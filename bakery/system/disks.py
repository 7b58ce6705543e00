"""On which kind of disk a folder lies."""

import os
import re
from pathlib import Path

# of Linux's file systems those whose files other machines may write; autofs is one that is mounted when it is looked at.  Not 9p:
# virtual machines have their own disks by it
NETWORK = {"afs", "autofs", "beegfs", "ceph", "cifs", "gpfs", "lustre", "nfs", "nfs4", "orangefs", "panfs", "smb3", "smbfs",
           "wekafs", "fuse.ceph", "fuse.glusterfs", "fuse.juicefs", "fuse.s3fs", "fuse.sshfs"}
_MOUNTS = Path("/proc/self/mounts")


def is_network(path: str | os.PathLike, mounts: Path = _MOUNTS) -> bool:
    """Whether a path, which need not exist, lies on a disk of the network; False where the system does not say."""
    try:
        lines = os.fsdecode(mounts.read_bytes()).splitlines()
    except OSError:
        return False
    # of two that are mounted at one place the later one is seen
    folders = {re.sub(r"\\([0-7]{3})", lambda match: chr(int(match[1], 8)), mount): kind
               for _, mount, kind, *_ in map(str.split, lines)}
    # as written first: that touches no disk, and one that hangs is mostly named without links
    return any(_kind(mount, folders) in NETWORK for mount in (os.path.abspath(path), os.path.realpath(path)))


def _kind(path: str, folders: dict[str, str]) -> str | None:
    above = next((str(folder) for folder in (Path(path), *Path(path).parents) if str(folder) in folders), None)
    return folders.get(above)
