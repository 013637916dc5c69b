"""What `sense` refuses to write beside the counts."""

import pytest

from megalopta.sensor import Crosstalk, ctia_preset
from megalopta.sensor.formats.products import check_product


@pytest.mark.parametrize(
    ("product", "changes", "message"),
    [
        ("events_npz", {}, "an integrating sensor has no single events"),
        (
            "binary_npy",
            {"crosstalk": Crosstalk(mean_fired_neighbors=0.1)},
            "binary frames have none",
        ),
        ("binary_spad512", None, "512 × 512"),
    ],
)
def test_what_a_sensor_cannot_give_is_refused(tiny, product, changes, message):
    sensor = tiny.sensors[1]
    if changes is not None:
        sensor = sensor.model_copy(update=changes) if changes else ctia_preset("ctia_si")
    with pytest.raises(ValueError, match=f"{product}: .*{message}"):
        check_product(product, sensor, (40, 48))
