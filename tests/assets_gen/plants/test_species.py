import pytest
from pydantic import ValidationError

from megalopta.assets_gen.plants.flora import BEECH, BUSHES, TREES
from megalopta.assets_gen.plants.species import Species


def test_there_are_broad_leaved_trees_and_two_conifers():
    needles = {name for name, species in TREES.items() if species.foliage.blade == "needles"}
    assert needles == {"pine", "spruce"} and len(TREES) == 6


def test_saplings_are_lower_and_thinner_than_their_trees():
    for name, sapling in BUSHES.items():
        if name.startswith("young "):
            tree = TREES[name.removeprefix("young ")]
            assert sapling.height_m < tree.height_m / 3 and sapling.radius_m < tree.radius_m / 2
            assert sapling.bark == tree.bark


def test_species_survive_the_round_trip_through_json():
    for species in (*TREES.values(), *BUSHES.values()):
        assert Species.model_validate_json(species.model_dump_json()) == species


@pytest.mark.parametrize(
    ("field", "value"), [("height_m", 0), ("radius_m", -1), ("flare", -0.1), ("trunk", 1)]
)
def test_impossible_plants_are_refused(field, value):
    with pytest.raises(ValidationError, match=field):
        Species.model_validate(BEECH.model_dump() | {field: value})
