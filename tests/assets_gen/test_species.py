import pytest
from pydantic import ValidationError

from megalopta.assets_gen.flora import BEECH, BUSHES, TREES
from megalopta.assets_gen.species import Species


def test_at_least_three_tree_species_and_a_conifer_are_there():
    assert len(TREES) >= 3 and len(BUSHES) >= 1
    assert {species.growth.kind for species in TREES.values()} == {"colonized", "whorled"}


def test_species_survive_the_round_trip_through_json():
    for species in (*TREES.values(), *BUSHES.values()):
        assert Species.model_validate_json(species.model_dump_json()) == species


@pytest.mark.parametrize(
    ("field", "value"), [("height_m", 0), ("radius_m", -1), ("flare", -0.1), ("trunk", 1)]
)
def test_impossible_plants_are_refused(field, value):
    with pytest.raises(ValidationError, match=field):
        Species.model_validate(BEECH.model_dump() | {field: value})
