import pytest
from pydantic import ValidationError

from megalopta.assets_gen.plants.species import Species
from megalopta.scenes.forest.flora import TREES


@pytest.mark.parametrize(
    ("field", "value"), [("height_m", 0), ("radius_m", -1), ("flare", -0.1), ("trunk", 1)]
)
def test_impossible_plants_are_refused(field, value):
    with pytest.raises(ValidationError, match=field):
        Species.model_validate(TREES["beech"].shape.model_dump() | {field: value})
