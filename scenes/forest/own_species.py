"""Species of the user's own: from a YAML file, or in the configuration itself.

An entry has the fields of `flora.yaml`. With `like`, it names a species of this program and gives
only what differs. Numbers are bounded: a file may come from a stranger.
"""

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from typing import Annotated, Any

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    ValidationInfo,
    field_validator,
    model_validator,
)

from megalopta.assets_gen.plants.species import Climbing, Colonized, Fronded, Species, Whorled
from megalopta.core import strict_yaml
from megalopta.core.bounded import folder_of, named_path, quoted, read_text, unreadable
from megalopta.core.freshness import digest
from megalopta.core.record import Record
from megalopta.core.validation import merged
from megalopta.scenes.forest.flora import ENTRIES, FLORA, PLANTS, Flora, woody
from megalopta.scenes.spectra.reflectance import LEAVES, REFLECTANCES

_MOST = 20
_LONGEST = 40
_MOST_LEAVES, _MOST_BRANCHES = 3e6, 2e4
_TALLEST_M = 100.0
_MOST_STEPS = 100


class Growing(Record, frozen=True):
    """Places of a bush or sapling in the undergrowth."""

    per_m2: Annotated[float, Field(ge=0, le=100)]
    """Plants per square meter where they are densest, or as `undergrowth_per_m2` says (1/m²)."""

    reach_m: Annotated[float, Field(gt=0, le=1000)] = 40.0
    """Largest distance from the camera's path (m)."""

    clearance_m: Annotated[float, Field(ge=0, le=100)] = 2.5
    """Smallest distance from the camera's path (m)."""

    scale: tuple[Annotated[float, Field(gt=0)], Annotated[float, Field(le=10)]] = (0.6, 1.25)
    """Smallest and largest size, as factors (1)."""


class OwnSpecies(Record, frozen=True):
    """Kind of tree, or with a `layer` of bush or sapling."""

    shape: Species
    """Stem, crown, growth and leaves."""

    bark: tuple[str, str]
    """Reflectances of light and dark bark by name, perhaps times a factor: `beech bark light *
    0.8`."""

    leaf: tuple[str, str]
    """Leaves by name, dark and light, perhaps times a factor of at most 1: `leaf dark * 0.9`."""

    layer: Growing | None = None
    """Place in the undergrowth; null: it is a tree."""

    @model_validator(mode="before")
    @classmethod
    def _changes_another(cls, fields: Any) -> Any:
        if not isinstance(fields, Mapping) or "like" not in fields:
            return fields
        if not isinstance(like := fields["like"], str) or like not in ENTRIES:
            raise ValueError(f"like: no species {quoted(like)!r}; use one of {', '.join(ENTRIES)}")
        changes = {key: value for key, value in fields.items() if key != "like"}
        return merged(ENTRIES[like], changes)

    @field_validator("bark", "leaf")
    @classmethod
    def _are_known(cls, names: tuple[str, str], validation: ValidationInfo) -> tuple[str, str]:
        known = LEAVES if validation.field_name == "leaf" else (*REFLECTANCES, *LEAVES)
        most = 1.0 if validation.field_name == "leaf" else 2.0
        for description in names:
            name, _, factor = description.partition(" * ")
            if name not in known:
                raise ValueError(
                    f"{quoted(description)!r} is unknown; use one of {', '.join(known)}"
                )
            if not 0 < _number(factor or "1") <= most:
                raise ValueError(
                    f"{quoted(description)!r}: give a factor above 0, at most {most:g}"
                )
        return names

    @model_validator(mode="after")
    def _is_of_this_world(self) -> "OwnSpecies":
        shape = self.shape
        if shape.height_m > _TALLEST_M or shape.crown.radius_m > _TALLEST_M:
            raise ValueError(f"shape: a plant is at most {_TALLEST_M:g} m high and wide")
        if not 2 <= len(shape.crown.profile) <= _MOST_STEPS:
            raise ValueError(
                f"shape.crown.profile has {len(shape.crown.profile)} radii; give 2 to {_MOST_STEPS}"
            )
        branches, leaves = size_of(shape)
        if branches > _MOST_BRANCHES or leaves > _MOST_LEAVES:
            raise ValueError(
                f"shape: about {branches:.2g} branches with {leaves:.2g} leaves; use at most "
                f"{_MOST_BRANCHES:.0e} and {_MOST_LEAVES:.0e}"
            )
        return self


def size_of(shape: Species) -> tuple[float, float]:
    """Return the approximate numbers of branches and leaves of a grown plant."""
    grows, axes, length = shape.growth, 0.0, 0.0
    match grows:
        case Colonized():
            axes = grows.points + grows.scaffold + grows.shoots + shape.height_m / grows.step_m
            length = grows.shoots * grows.shoot_m
        case Whorled():
            axes = shape.height_m / grows.spacing_m * grows.branches
            length = axes * shape.crown.radius_m
        case Fronded():
            axes = float(grows.fronds)
            length = axes * grows.frond_m
        case Climbing():
            axes = float(grows.shoots)
            length = axes * grows.shoot_m
    twigs = shape.foliage.twigs
    bearing = length * twigs.per_m * twigs.length_m if twigs else length
    return axes * shape.stems, bearing * shape.foliage.per_m * shape.stems


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return 0.0


def _read(source: Any, validation: ValidationInfo) -> Any:
    if not isinstance(source, str):
        return source
    path = named_path(source, folder_of(validation))
    with unreadable(path):
        entries = strict_yaml.load(read_text(path))
    if not isinstance(entries, Mapping):
        raise ValueError(f"{path}: no mapping of names to species; give at least one")
    return entries


def _named(species: dict[str, OwnSpecies]) -> dict[str, OwnSpecies]:
    for name in species:
        if name in PLANTS:
            raise ValueError(f"{name}: this name is taken; give another one")
        if not name.replace(" ", "").replace("-", "").isalnum() or len(name) > _LONGEST:
            raise ValueError(
                f"{quoted(name)!r} cannot name a species: use letters, digits, dash and space, at "
                f"most {_LONGEST}"
            )
    return species


SpeciesByName = Annotated[
    dict[str, OwnSpecies], Field(max_length=_MOST), BeforeValidator(_read), AfterValidator(_named)
]
"""Species by name; a path of a YAML file is replaced by what it holds."""


def flora_of(species: Mapping[str, OwnSpecies]) -> Flora:
    """Return the plants of this program and species of the user's own."""
    return _flora(tuple(species.items()))


@lru_cache(maxsize=8)
def _flora(species: tuple[tuple[str, OwnSpecies], ...]) -> Flora:
    if not species:
        return FLORA
    named = (
        replace(woody(name, kind.model_dump(mode="json")), variety=digest(kind.model_dump_json()))
        for name, kind in species
    )
    return Flora.of([*FLORA.trees.values(), *FLORA.bushes.values(), *named])
