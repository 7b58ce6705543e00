"""What a scene of the screen-space renderer may say: a picture without fog, the fog, the light upon it, and the filter."""

# no annotations from __future__: pydantic would have to compile each of them again
from collections.abc import Iterator
from typing import Annotated

from pydantic import Discriminator, Field, Tag

from bakery.errors import Problem
from bakery.grammar.fields import Flag, Path, number, numbers, whole, word
from bakery.grammar.section import Section, pick
from bakery.grammar.text import Mapping, Sequence, owner
from renderers.scene.common import LENGTH, Common, Direction, Length, Position, box_problems, direction_problems, node_at

KERNELS = ("flux", "fluence", "forward", "single", "small_angle", "small_angle_absorbing", "erf", "path_integral", "elek")
NEEDS = ("medium", "beam")  # stages of the asset
FILES = ("picture.color", "picture.depth", "picture.mitsuba", "fog.density.file")
RESUMES = False  # a filter has no samples
CHOICE = "filter.kernel", KERNELS  # the key of the method, and what it may be
# of `bake trade`: what the others are held against; kept within a scene's tolerance: none; all that are tried
EXACT, KEPT = ("flux",), ()
POINTS = (*EXACT, "flux:cut_off=8", "flux:picture.samples=64", "flux:picture.samples=16", *KERNELS[1:])
UNUSED = {
    "measure": "none: the noise is that of the picture as a whole",
    "scene": "picture: {mitsuba: …}",
    "film": "none: it takes the size of the picture",
    "stop.samples": "picture: {samples: …}, of a Mitsuba scene",
}


# ---- the picture


class _Distances(Section):
    unit: Length = Field(1.0, description="Length of one unit of the depth or of the Mitsuba scene, such as 1 cm.")
    far: Length | None = Field(None, description="Distance of pixels without a surface; the fog ends there.")


class Files(_Distances):
    color: Path = Field(description="EXR (linear) or PNG (sRGB) file of the picture without fog.")
    layer: Path | None = Field(None, description="For an EXR file with several layers: X for the channels X.R, X.G, X.B.")
    depth: Path = Field(description="File of the distances: EXR, NPY, or PNG of 16 bits.")
    channel: Path | None = Field(None, description="Channel of a depth file with several, such as depth.Z.")
    measure: word("distance", "z") = Field(description="distance (from the camera) or z (along its axis).")
    sky: number() | None = Field(None, description="A depth that means no surface, besides inf.")


class Rendered(_Distances):
    mitsuba: Path = Field(description="Mitsuba scene (XML), without fog; its first sensor is the camera.")
    samples: whole(1, 10**6) | None = Field(None, description="Samples a pixel; default: the scene's.")


Picture = Annotated[
    Annotated[Files, Tag("files")] | Annotated[Rendered, Tag("mitsuba")],
    Discriminator(
        lambda node: None if not isinstance(node, Mapping) else "mitsuba" if "mitsuba" in node
        else "files" if "color" in node or "depth" in node else None,
        custom_error_type="choice",
        custom_error_message="|{mitsuba: …}|{color: …, depth: …, measure: …}",
    ),
]


# ---- the fog

Scale = number(least=0, most=1e12)


class UniformDensity(Section):
    type: word("uniform") = Field(description="The same everywhere.")
    scale: Scale = Field(1.0, description="Density relative to the asset's medium.")


class HeightDensity(Section):
    type: word("height") = Field(description="Constant up to a height, falling exponentially above.")
    scale: Scale = Field(1.0, description="Density at the ground relative to the asset's medium.")
    base: number(LENGTH) = Field(0.0, description="Height from which the density falls.")
    falloff: Length = Field(description="Height over which the density falls by a factor of e.")
    up: Direction = Field((0.0, 0.0, 1.0), description="Direction in which heights are measured.")


class GridDensity(Section):
    type: word("grid") = Field(description="Trilinear between the values of a file.")
    file: Path = Field(description="File of the densities: HDF5, NPY or Mitsuba's VOL.")
    dataset: Path | None = Field(None, description="Name of the dataset in an HDF5 file.")
    lo: Position | None = Field(None, description="Corner of the box that the grid fills; a VOL file holds its own.")
    hi: Position | None = Field(None, description="The opposite corner.")
    scale: Scale = Field(1.0, description="Factor on the file's values.")


Density = Annotated[
    Annotated[UniformDensity, Tag("uniform")] | Annotated[HeightDensity, Tag("height")] | Annotated[GridDensity, Tag("grid")],
    pick("type", ("uniform", "height", "grid")),
]


class Sun(Section):
    type: word("sun") = Field(description="Parallel light.")
    direction: Direction = Field(description="Direction in which the light travels.")
    irradiance: numbers(least=0, most_entries=3) = Field(description="Irradiance across its direction; one value or [r, g, b].")


class Ambient(Section):
    type: word("ambient") = Field(description="Light from outside the picture, the same in all directions.")
    radiance: numbers(least=0, most_entries=3) = Field(description="Radiance: one value or [r, g, b].")


Light = Annotated[Annotated[Sun, Tag("sun")] | Annotated[Ambient, Tag("ambient")], pick("type", ("sun", "ambient"))]


class Fog(Section):
    density: Density = Field(UniformDensity.model_construct(type="uniform", scale=1.0), description="Density of the fog.")
    light: Annotated[list[Light], Field(max_length=64)] = Field((), description="Light that falls on the fog from outside.")
    diffuse: Flag = Field(True, description="Whether that light is also added where the fog scatters it more than once.")


# ---- filter


class Filter(Section):
    kernel: word(*KERNELS) = Field(
        "flux", description="flux: what a surface across the beam receives; the others for comparison."
    )
    energy: word("kept", "lost") | None = Field(
        None, description="Of scattered light. lost: without light that goes back past the camera; kept: with it.  With ambient "
        "lost, else kept."
    )
    outside: word("edge", "black") | None = Field(
        None, description="What is outside the picture: edge, as near its edge; black.  With ambient light that, else edge."
    )
    cut_off: number(above=0, most=1e6, words={"none": None}) = Field(
        None, description="Where the kernel is cut, in its own widths; the light cut off is spread over the rest."
    )


class SceneFile(Common):
    """A picture, seen through fog."""

    picture: Picture = Field(description="The picture without fog.")
    fog: Fog = Field(description="The fog; this section chooses the renderer.")
    filter: Filter = Field(
        Filter.model_construct(kernel="flux", energy=None, outside=None, cut_off=None), description="How light is spread."
    )


# ---- what has to hold between keys


def problems(root: Mapping, values: dict) -> Iterator[Problem]:
    """Problems between keys; `values` are those that are well formed by themselves."""
    picture, camera = root.get("picture"), root.get("camera")
    if isinstance(picture, Mapping) and "mitsuba" in picture and camera is not None:
        yield owner(camera).problem("found a camera beside a Mitsuba scene", "expected none: the scene's sensor is the camera")
    if isinstance(picture, Mapping) and "mitsuba" not in picture and camera is None:
        yield owner(picture).problem("missing", "expected camera: {origin: …, target: …, fov: …}, of this picture", key="camera")
    if isinstance(picture, Mapping) and "mitsuba" not in picture and "stop" in root:
        yield root.names["stop"].problem("found when to stop beside a picture from files", "expected none: it is not rendered")
    if isinstance(picture, Mapping) and "mitsuba" not in picture and values.get("denoise") == "yes":
        yield owner(root["denoise"]).problem("found yes beside a picture from files",
                                             "expected no, or a picture that is rendered: the noise of files is not known")
    yield from direction_problems(root, values, "fog.density.up")
    yield from _grid(root, values)
    lights = node_at(root, "fog.light")
    for i, light in enumerate(lights if isinstance(lights, Sequence) else ()):
        if isinstance(light, Mapping):
            yield from _light(light, values, f"fog.light[{i}]")
            yield from direction_problems(root, values, f"fog.light[{i}].direction")
            if values.get(f"fog.light[{i}].type") == "ambient" and values.get("filter.outside") is not None:
                yield node_at(root, "filter.outside").place.problem(
                    f"found {values['filter.outside']} beside ambient light", "expected none: ambient light is what lies outside")


def _grid(root: Mapping, values: dict) -> Iterator[Problem]:
    density = node_at(root, "fog.density")
    if values.get("fog.density.type") != "grid" or not isinstance(density, Mapping):
        return
    suffix = str(values.get("fog.density.file", "")).lower().rpartition(".")[2]
    if "fog.density.file" in values and suffix not in ("h5", "hdf5", "npy", "vol"):
        yield density["file"].place.problem(f"found a file that ends in .{suffix}", "expected .h5, .hdf5, .npy or .vol")
    if suffix in ("h5", "hdf5") and "dataset" not in density:
        yield owner(density).problem("missing", "expected dataset: the name of a dataset in the file", key="fog.density.dataset")
    if suffix in ("npy", "vol") and "dataset" in density:
        yield owner(density["dataset"]).problem("found a dataset", f"expected none: .{suffix} files hold one array")
    for corner in ("lo", "hi"):
        if suffix in ("h5", "hdf5", "npy") and corner not in density:
            yield owner(density).problem("missing", f"expected {corner}: a corner of the grid's box, such as [0, 0, 0] m",
                                         key=f"fog.density.{corner}")
    yield from box_problems(root, values, "fog.density")


def _light(light: Mapping, values: dict, key: str) -> Iterator[Problem]:
    amount = "radiance" if values.get(f"{key}.type") == "ambient" else "irradiance"
    node = light.get(amount)
    count = len(node) if isinstance(node, Sequence) else len(values.get(f"{key}.{amount}") or ())
    if count == 2:
        yield owner(node).problem("found 2 entries", "expected one, or three: red, green and blue")
