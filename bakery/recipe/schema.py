"""What a recipe may say: every key with its kind of value, its default and its description.

The models validate the tree of `text.py` and give the JSON Schema that editors use; the kinds of values are in `fields.py`,
grains in `grain_schema.py`, what has to hold between keys in `checks.py`.  Sections whose stage does not exist yet are known here
and refused there.
"""

# no annotations from __future__: pydantic would have to compile each of them again, some 3 ms in all
from typing import Annotated

from pydantic import Discriminator, Field, Tag

from bakery.grammar.fields import (
    AUTO,
    ComponentName,
    Flag,
    Format,
    GeometricDeviation,
    Length,
    Name,
    Path,
    Share,
    Text,
    number,
    numbers,
    whole,
    word,
)
from bakery.grammar.section import HostOf, MaterialOf, Section, pick
from bakery.grammar.text import Mapping, Sequence
from bakery.grammar.units import ANGLE, COEFFICIENT, DENSITY, FRACTION, LENGTH, WAVELENGTH
from bakery.recipe.grain_schema import EffectiveMedium, Grains, Scatterometer

NAMED_WAVELENGTHS = {"rgb": (0.610, 0.550, 0.465), "visible8": (0.405, 0.455, 0.505, 0.555, 0.605, 0.655, 0.705, 0.755)}


# ---- particles


class _Cut(Section):
    min: Length | None = Field(None, description="Smallest radius: the density is cut there and renormalised.")
    max: Length | None = Field(None, description="Largest radius: the density is cut there and renormalised.")


class SingleSize(Section):
    distribution: word("single") = Field(description="All particles have one radius.")
    radius: Length = Field(description="Radius, such as 5 um.")


class LognormalSize(_Cut):
    distribution: word("lognormal") = Field(description="ln r is normally distributed.")
    radius: Length = Field(description="Geometric mean (= median) radius by number.")
    sigma: GeometricDeviation = Field(description="Geometric standard deviation, above 1.")


class GammaSize(_Cut):
    distribution: word("gamma") = Field(description="Gamma distribution of Hansen and Travis.")
    radius: Length = Field(description="Effective radius <r^3>/<r^2>.")
    variance: number(FRACTION, least=1e-6, below=1 / 3) = Field(description="Effective variance, below 1/3.")


class TableSize(_Cut):
    distribution: word("table") = Field(description="Number density from a CSV file.")
    file: Path = Field(description="CSV file with the columns radius_um and dn/dr (any scale).")


class _Part(Section):
    share: Share = Field(description="Share of the particle number; shares add up to 1.")


class SinglePart(_Part, SingleSize):
    pass


class LognormalPart(_Part, LognormalSize):
    pass


class GammaPart(_Part, GammaSize):
    pass


class TablePart(_Part, TableSize):
    pass


Part = Annotated[
    Annotated[SinglePart, Tag("single")]
    | Annotated[LognormalPart, Tag("lognormal")]
    | Annotated[GammaPart, Tag("gamma")]
    | Annotated[TablePart, Tag("table")],
    pick("distribution", ("single", "lognormal", "gamma", "table")),
]


class MixtureSize(_Cut):
    distribution: word("mixture") = Field(description="Sum of several distributions.")
    of: list[Part] = Field(min_length=1, max_length=256, description="The distributions, each with its share.")


Size = Annotated[
    Annotated[SingleSize, Tag("single")]
    | Annotated[LognormalSize, Tag("lognormal")]
    | Annotated[GammaSize, Tag("gamma")]
    | Annotated[TableSize, Tag("table")]
    | Annotated[MixtureSize, Tag("mixture")],
    pick("distribution", ("single", "lognormal", "gamma", "table", "mixture")),
]


class Component(Section):
    name: ComponentName = Field(description="Name of the group in the asset.")
    material: MaterialOf = Field(description="A material of assets/materials, {n, k}, or {file}.")
    fraction: Share = Field(1.0, description="Share of the particle number; the shares of all components add up to 1.")
    size: Size = Field(description="Distribution of the radii.")


class Particles(Section):
    """Suspended spheres."""

    host: HostOf = Field("air", description="What the spheres float in: a material, {n}, or {file}.")
    number_density: number(DENSITY, above=0, most=1e30) | None = Field(None, description="Spheres per volume, such as 1e8 /m^3.")
    volume_fraction: number(FRACTION, above=0, below=1) | None = Field(None, description="Volume of the spheres per volume.")
    components: list[Component] = Field(min_length=1, max_length=256, description="The kinds of particles.")


class SingleScattering(Section):
    """Options of the single-scattering stage."""

    method: word("auto", "mie", "goa") = Field(
        "auto", description="How spheres are computed: series (mie), rays for the large ones (goa), or rays where they are "
        "measured to be good enough and save time (auto)."
    )
    orders: whole(0, 50) = Field(3, description="Rays: highest number of chords.")
    polarized: Flag = Field(False, description="Also bake the Mueller elements s11, s12, s33, s34.")
    switch: number(least=30, most=1e8, words=AUTO) = Field("auto", description="Size parameter from which method goa takes rays.")
    edge: word("narrow", "wide", "none") = Field("narrow", description="Rays: window of exact waves at the edge of a sphere.")
    rainbow: Flag = Field(True, description="Rays: the uniform formula at rainbows.")
    axis: Flag = Field(True, description="Rays: the uniform formula at 0 and 180 degrees.")
    radii: whole(3, 10**6, words=AUTO) = Field("auto", description="Number of sizes, whatever error they leave.")
    angles: whole(3, 10**6, words=AUTO) = Field("auto", description="Number of angles, whatever error they leave.")


# ---- medium


class HenyeyGreenstein(Section):
    type: word("hg") = Field(description="Henyey-Greenstein.")
    g: numbers(above=-1, below=1) = Field(description="Mean cosine, between -1 and 1; one value, or one a wavelength.")


class Isotropic(Section):
    type: word("isotropic") = Field(description="The same in all directions.")


class Rayleigh(Section):
    type: word("rayleigh") = Field(description="Rayleigh scattering of unpolarised light.")


class Gaussian(Section):
    type: word("gaussian") = Field(description="A Gaussian lobe about the forward direction.")
    spread: number(ANGLE, least=1e-6, most=3.141592653589794) = Field(
        description="Standard deviation of the angle, such as 30 deg."
    )


class PhaseTable(Section):
    type: word("table") = Field(description="From a CSV file.")
    file: Path = Field(description="CSV file with the columns theta_deg (or theta_rad), 0 to 180 degrees, and value (any scale).")


MediumPhase = Annotated[
    Annotated[HenyeyGreenstein, Tag("hg")]
    | Annotated[Isotropic, Tag("isotropic")]
    | Annotated[Rayleigh, Tag("rayleigh")]
    | Annotated[Gaussian, Tag("gaussian")]
    | Annotated[PhaseTable, Tag("table")],
    pick("type", ("hg", "isotropic", "rayleigh", "gaussian", "table")),
]


class Medium(Section):
    """A continuous medium: albedo and mean_free_path, or sigma_s and sigma_a."""

    albedo: numbers(FRACTION, least=0, most=1) | None = Field(
        None, description="Single-scattering albedo; one value, or one a wavelength."
    )
    mean_free_path: numbers(LENGTH, above=0) | None = Field(None, description="1/sigma_t, such as [0.84, 0.75, 0.68] mm.")
    sigma_s: numbers(COEFFICIENT, least=0) | None = Field(
        None, description="Scattering coefficient, such as [2.1, 2.3, 2.5] /mm."
    )
    sigma_a: numbers(COEFFICIENT, least=0) | None = Field(None, description="Absorption coefficient.")
    phase: MediumPhase = Field(description="Phase function.")


# ---- packing


class RadiusShare(Section):
    share: Share = Field(description="Share of the spheres.")
    radius: number(least=1e-6, most=1e6) = Field(description="Radius relative to the others.")


class RadiusLaw(Section):
    distribution: word("lognormal") = Field(description="ln r is normally distributed.")
    sigma: GeometricDeviation = Field(description="Geometric standard deviation by number, above 1.")


Radii = Annotated[
    Annotated[word("equal"), Tag("word")]
    | Annotated[list[RadiusShare], Field(min_length=1, max_length=256), Tag("list")]
    | Annotated[RadiusLaw, Tag("law")],
    Discriminator(lambda node: "list" if isinstance(node, Sequence) else "law" if isinstance(node, Mapping) else "word"),
]


class Packing(Section):
    """Spheres in a periodic tile."""

    fraction: numbers(FRACTION, least=1e-6, below=1) = Field(
        description="Share of the volume in spheres, up to 0.64 for equal ones; a list bakes a dictionary of tiles."
    )
    count: whole(1, 10**6) = Field(500, description="Spheres in the tile.")
    cell: Annotated[list[number(least=1e-6, most=1e6)], Field(min_length=3, max_length=3)] = Field(
        (1.0, 1.0, 1.0), description="Proportions of the cell."
    )
    radii: Radii = Field("equal", description="equal, a list of {share, radius}, or {distribution: lognormal, sigma}.")
    growth: number(least=1e-5, most=1, words=AUTO) = Field(
        "auto", description="Growth of the diameters over the thermal speed where it is slowest; auto: by the tolerance."
    )
    equilibration: whole(0, 10**6, words=AUTO) = Field(
        "auto", description="Collisions a sphere at the final size, at fractions up to 0.5; auto: by the tolerance."
    )
    seed: whole(0, 2**53) | None = Field(None, description="Of the tiles; the recipe's seed if absent.")


# ---- sections whose stages are yet to come


class Discrete(Section):
    """One random realisation."""

    count: whole(1, 10**9) = Field(description="Number of particles.")
    box: Annotated[list[Length], Field(min_length=3, max_length=3)] = Field(description="Edges of the box.")


class MultipleScattering(Section):
    """Precomputed multiple scattering."""

    sources: Annotated[list[word("point", "segment")], Field(min_length=1, max_length=2)] = Field(
        ("point", "segment"), description="Kinds of sources."
    )
    extent: number(least=0.5, most=200, words=AUTO) = Field(
        "auto", description="Distance that the tables cover, in mean free paths; auto: all but 1e-4 of the light."
    )
    length: number(least=0.1, most=10) = Field(2.0, description="Length of the tabulated segment, in mean free paths.")
    tolerance: number(FRACTION, least=1e-4, most=0.5) | None = Field(
        None, description="Relative error of a lobe; the recipe's tolerance, but at least 1 %, if absent."
    )
    orders: whole(2, 128, words=AUTO) = Field("auto", description="Legendre orders that are solved; narrower peaks are left out.")
    method: word("auto", "solver", "photons") = Field(
        "auto", description="How tables are made; auto: photons where the solver refuses or its error is above 20 %."
    )
    photons: whole(1000, 10**10, words=AUTO) = Field(
        "auto", description="Photons that are followed for a wavelength, at most; auto: as many as fly 4e7 times."
    )


class Beam(Section):
    """Narrow-beam kernels."""

    depth: number(least=0.01, most=1000) = Field(32.0, description="Deepest depth, in mean free paths.")
    tolerance: number(FRACTION, least=1e-3, most=0.5) | None = Field(
        None, description="Relative error of the fluence; the recipe's tolerance, but at least 3 %, if absent."
    )
    photons: whole(1000, 10**9, words=AUTO) = Field(
        "auto", description="Photons that measure the error of each wavelength; auto: as many as show that the tolerance is met."
    )


class RecipeFile(Section):
    """What one material is made of."""

    bakery: Format = Field(description="Recipe format.")
    name: Name = Field(description="The asset is NAME.h5 unless -o says otherwise.")
    description: Text = Field("", description="Free text.")
    wavelengths: numbers(WAVELENGTH, words=NAMED_WAVELENGTHS, least=1e-9, most=1e6) = Field(
        NAMED_WAVELENGTHS["rgb"], description="rgb, visible8, or a list in um, in vacuum."
    )
    seed: whole(0, 2**53) = Field(0, description="Every random stream derives from it.")
    tolerance: number(FRACTION, least=1e-6, most=0.5) = Field(0.01, description="Error that each baked figure should reach.")
    measure: word("pointwise", "integrated") = Field(
        "pointwise", description="Where the tolerance of particles' phase functions holds: at every angle, or for the light as a "
        "whole (the integral of the error over the sphere)."
    )
    particles: Particles | None = Field(None, description="Suspended spheres: fog, dust, bubbles.")
    grains: Grains | None = Field(None, description="Packed grains: sand, snow, sugar.")
    packing: Packing | None = Field(None, description="Periodic tiles of packed spheres; alone or with grains.")
    medium: Medium | None = Field(None, description="A continuous medium given by its coefficients: milk, wax, skin.")
    phase: SingleScattering | None = Field(None, description="Options of the single-scattering stage.")
    discrete: Discrete | None = Field(None, description="One random realisation (not available yet).")
    scatterometer: Scatterometer | None = Field(None, description="Options of the grain stage.")
    effective_medium: EffectiveMedium | None = Field(None, description="Options of the medium that stands for packed grains.")
    multiple_scattering: MultipleScattering | None = Field(
        None, description="Tables of the light that is scattered three times and more."
    )
    beam: Beam | None = Field(None, description="Kernels of narrow beams: how light spreads.")


SOURCES = ("particles", "grains", "medium")
NOT_YET = ("discrete",)
