"""What formats of meshes and of packed spheres share."""

from collections.abc import Mapping

from bakery.export.declaration import Job, Written

_MESHES = "grains keep all their digits, in radii of their bounding sphere; surfaces and figures stay in the asset (--to csv)"
_TILES = "positions and radii keep all their digits; g2, chords and their errors stay in the asset (--to csv)"


def written(job: Job, meshes: Mapping[str, str], tiles: Mapping[str, str]) -> Written:
    """Files of meshes and of tiles, both by the end of their name."""
    files = {f"{job.stem}{end}": content for end, content in meshes.items()}
    files |= {f"{job.stem}{'_tile' if meshes and not end.startswith('_') else ''}{end}": content
              for end, content in tiles.items()}
    return Written(files, [], [_MESHES] * bool(meshes) + [_TILES] * bool(tiles))
