"""What the parts of the schema are made of: a mapping of known keys, the choice between several, and materials."""

# no annotations from __future__: pydantic would have to compile each of them again, some 3 ms in all
from typing import Annotated, Any, ClassVar

from pydantic import BaseModel, ConfigDict, Discriminator, Field, Tag, model_validator

from bakery.grammar.fields import Material, Path, Share, numbers, word
from bakery.grammar.text import Mapping, Scalar, closest

RULES = ("bruggeman", "maxwell_garnett", "lorentz_lorenz", "volume")  # of mixtures, as `bakery.physics.materials.mixing` has them


class Section(BaseModel):
    """A mapping of known keys."""

    # deferred: the root builds one validator of all models; building each by itself first takes 40 ms more
    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)
    named: ClassVar[dict[str, type]] = {}  # every mapping of known keys: pydantic's errors give names of classes

    def __init_subclass__(cls, **options):
        super().__init_subclass__(**options)
        Section.named[cls.__name__] = cls

    @model_validator(mode="before")
    @classmethod
    def _remember(cls, data: Any) -> Any:
        if isinstance(data, Mapping):
            data.model = cls  # an unknown key is compared with the keys of this model
        return data

    @classmethod
    def elsewhere(cls, section: Mapping) -> "tuple[str, str, str] | None":
        """An unknown key that shows that another section is meant, what is found and what would do.  It is all that is said of
        unknown and missing keys of the mapping then."""
        return None


STANDS_FOR = {"diameter": "radius", "g": "phase"}  # what people write -> the key that takes it
SHARES = ("fraction", "weight", "share")  # how much of it: each list of parts has its own word


def likely(section: Mapping, name: str) -> str:
    """The key that an unknown one seems to stand for, among those that the mapping lacks; "" where there is none."""
    names = [field for field in section.model.model_fields if field not in section] if section.model else []
    if name in SHARES:
        return next((field for field in names if field in SHARES), "")
    if STANDS_FOR.get(name) in names:
        return STANDS_FOR[name]
    return closest(name, names)


def meant(section: Mapping) -> set[str]:
    """The keys that a mapping's unknown ones seem to stand for: what is said of those would be false."""
    return {likely(section, name) for name in section if section.model and name not in section.model.model_fields} - {""}


def given(section: Mapping, *names: str) -> list[str]:
    """Which of the keys a mapping has, be it in another spelling."""
    misspelt = meant(section)
    return [name for name in names if name in section or name in misspelt]


def pick(key: str, choices: tuple[str, ...]) -> Discriminator:
    """Chooses the model of a mapping by one of its words."""

    def tag(node):
        chosen = node.get(key) if isinstance(node, Mapping) else None
        return chosen.text if isinstance(chosen, Scalar) and chosen.text in choices else None

    return Discriminator(tag, custom_error_type="choice", custom_error_message="|".join((key, *choices)))


SMALLEST_N = 1e-3  # no material has less; size parameters and relative indices stay within range


class NK(Section):
    """Optical constants n + ik, absolute (relative to vacuum)."""

    n: numbers(least=SMALLEST_N, most=1000) = Field(
        description="Real part of the refractive index, relative to vacuum; one value, or one a wavelength."
    )
    k: numbers(least=0, most=1000) = Field(
        (0.0,), description="Imaginary part (absorption), 0 or larger; one value, or one a wavelength."
    )


class HostIndex(Section):
    """A clear host."""

    n: numbers(least=SMALLEST_N, most=1000) = Field(
        description="Refractive index relative to vacuum; one value, or one a wavelength.")


class MaterialFile(Section):
    """A table from a file."""

    file: Path = Field(description="CSV file with the columns wavelength_um, n and, optionally, k; YAML of refractiveindex.info; "
                       "text of the Aerosol Refractive Index Archive.")
    relative_to: word("vacuum", "air") | None = Field(
        None, description="What n is relative to, and wavelengths are measured in; without it what the file says, else vacuum.")


def _index_tag(node):
    if isinstance(node, Scalar):
        return "name"
    return None if not isinstance(node, Mapping) else "file" if "file" in node else "index"


_index = Discriminator(_index_tag, custom_error_type="choice",
                       custom_error_message="|the name of a material|{n: …, k: …}|{file: …}")
PureMaterialOf = Annotated[Annotated[Material, Tag("name")] | Annotated[NK, Tag("index")] | Annotated[MaterialFile, Tag("file")],
                           _index]


class Ingredient(Section):
    """A material with its share of a mixture."""

    material: PureMaterialOf = Field(description="A material of assets/materials, {n, k}, or {file}.")
    share: Share = Field(description="Share of the mixture's volume.")


class MixedMaterial(Section):
    """A fine mixture of several materials, of which light sees one index."""

    mixing: word(*RULES) = Field(
        description="Rule: bruggeman, maxwell_garnett (inclusions in a matrix), lorentz_lorenz or volume (the mean of n and k)."
    )
    matrix: PureMaterialOf | None = Field(None, description="For maxwell_garnett: fills the rest of the volume.")
    of: list[Ingredient] = Field(min_length=1, max_length=32, description="The materials, each with its share of the volume.")


def _material_tag(node):
    mixture = isinstance(node, Mapping) and ("mixing" in node or "of" in node)
    return "mixing" if mixture else _index_tag(node)


_material = Discriminator(_material_tag, custom_error_type="choice",
                          custom_error_message="|the name of a material|{n: …, k: …}|{file: …}|{mixing: …, of: …}")
MaterialOf = Annotated[Annotated[Material, Tag("name")] | Annotated[NK, Tag("index")] | Annotated[MaterialFile, Tag("file")]
                       | Annotated[MixedMaterial, Tag("mixing")], _material]
HostOf = Annotated[Annotated[Material, Tag("name")] | Annotated[HostIndex, Tag("index")] | Annotated[MaterialFile, Tag("file")],
                   _index]
