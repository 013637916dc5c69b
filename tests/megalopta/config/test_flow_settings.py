import numpy as np
import pytest

from megalopta.config.measuring import FlowSettings

PURITY = np.array([0.0, 0.4, 0.75, 1.0])


@pytest.mark.parametrize(
    ("mixed", "weights"),
    [("score", None), ("leave_out", [0, 0, 1, 1]), ("weigh", PURITY.tolist())],
)
def test_pixels_count_as_the_setting_says(mixed, weights):
    found = FlowSettings(mixed=mixed).weights(PURITY)
    assert found is None if weights is None else found.tolist() == weights
