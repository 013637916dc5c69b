import math

import numpy as np
import pytest
from pydantic import ValidationError

from megalopta.scenes.hashed_file import HashedFile
from megalopta.scenes.haze import Haze
from megalopta.scenes.scene import Environment, Scene
from megalopta.scenes.spectra.spectrum import flat


@pytest.mark.parametrize("visibility_m", [30.0, 4000.0])
def test_two_percent_of_a_beam_are_left_at_the_visibility(visibility_m):
    haze = Haze(visibility_m=visibility_m)
    left = math.exp(-haze.extinction_per_m * visibility_m)
    assert left == pytest.approx(0.02)
    assert haze.extinction_per_m == pytest.approx(3.912 / visibility_m, rel=1e-5)  # Koschmieder


@pytest.mark.parametrize(
    ("field", "value"),
    [("visibility_m", 0), ("visibility_m", np.nan), ("albedo", 1.1), ("asymmetry", 1)],
)
def test_impossible_haze_is_refused(field, value):
    with pytest.raises(ValidationError, match=field):
        Haze.model_validate({"visibility_m": 100, field: value})


def test_haze_around_nothing_or_before_a_panorama_is_refused():
    haze = Haze(visibility_m=100)
    with pytest.raises(ValueError, match="haze fills the space around objects, and there is none"):
        Scene({}, {}, (), haze=haze)
    picture = Environment(HashedFile(path="x", sha256="0" * 64), 0, (flat(1.0),) * 3, 1.0)
    with pytest.raises(ValueError, match="haze fills the space around objects"):
        Scene({}, {}, (), environment=picture, haze=haze)
