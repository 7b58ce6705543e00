"""Folders for what people look at, and tables as CSV."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from bakery.errors import UsageError

PREVIEW_OF = "bakery content_hash"  # key in the text of a preview's PNG, as renderers/preview/picture.py writes it
PREVIEW_WIDTH = 1160  # pixels: two panels of the default preview


def folder_for(path: Path) -> Path:
    """The folder, made if it is missing."""
    if str(path) == "-":
        raise UsageError("-: outputs go into a folder, not to standard output; name one with -o")
    try:
        path.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        raise UsageError(f"{path}: found a file where a folder should be; choose another with -o") from None
    except OSError as error:
        raise UsageError(f"{path}: the folder cannot be made: {error.strerror}; choose another with -o") from None
    return path


@contextmanager
def folder_filled(path: Path) -> Iterator[Path]:
    """The folder, made if it is missing; where what is to fill it fails before its first file, what was made is gone again."""
    missing = [folder for folder in (path, *path.parents) if not folder.exists()]
    folder = folder_for(path)
    try:
        yield folder
    except BaseException:
        for created in missing:
            with suppress(OSError):  # it holds a file
                created.rmdir()
        raise


def preview_beside(asset: Path, content_hash: str) -> bytes:
    """The preview that `bake render` put beside an asset, NAME.png, as JPEG; b"" where there is none of exactly this content."""
    from PIL import Image, UnidentifiedImageError

    try:
        with Image.open(asset.with_suffix(".png"), formats=("PNG",)) as image:
            if image.info.get(PREVIEW_OF, "").strip('"') != content_hash:  # Mitsuba writes texts in quotation marks
                return b""
            image = image.convert("RGB")
    except (OSError, UnidentifiedImageError, ValueError):  # missing, no picture, or a damaged one
        return b""
    image.thumbnail((PREVIEW_WIDTH, PREVIEW_WIDTH))
    return as_jpeg(image)


def as_jpeg(image) -> bytes:
    """A picture of PIL, or the bytes of a PNG, as JPEG: a tenth of the bytes where it is shaded."""
    import io

    from PIL import Image

    image = Image.open(io.BytesIO(image)) if isinstance(image, bytes) else image
    out = io.BytesIO()
    image.convert("RGB").save(out, "JPEG", quality=85)
    return out.getvalue()


def csv_text(columns: Sequence[tuple[str, Sequence]]) -> str:
    """Columns of equal length as CSV (RFC 4180, but with plain line ends); numbers with all their digits."""
    import csv
    import io

    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow([heading for heading, _ in columns])
    writer.writerows(zip(*(_cells(values) for _, values in columns), strict=True))
    return out.getvalue()


def _cells(values) -> list:
    plain = values.tolist() if hasattr(values, "tolist") else values
    return [repr(value) if isinstance(value, float) else value for value in plain]
