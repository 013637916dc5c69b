"""What `sense` refuses to write beside the counts."""

import numpy as np
import pytest

from megalopta.sensor import Crosstalk, changed, ctia_preset, preset
from megalopta.sensor.formats.products import check_product
from megalopta.sensor.sampling.streams import Draw
from megalopta.sensor.shot import NextFrames, Shot


@pytest.mark.parametrize(
    ("product", "changes", "message"),
    [
        ("events_npz", {}, "an integrating sensor has no single events"),
        (
            "binary_npy",
            {"crosstalk": Crosstalk(mean_fired_neighbors=0.1)},
            "binary frames have none",
        ),
    ],
)
def test_what_a_sensor_cannot_give_is_refused(tiny, product, changes, message):
    sensor = tiny.sensors[1].model_copy(update=changes) if changes else ctia_preset("ctia_si")
    with pytest.raises(ValueError, match=f"{product}: .*{message}"):
        check_product(product, sensor, (40, 48))


def test_light_is_not_known_beyond_the_next_frame():
    following = NextFrames(
        radiance=np.ones((1, 2, 2, 1)),
        flow=np.zeros((1, 2, 2, 2)),
        hidden=np.zeros((1, 2, 2), bool),
    )
    sensor = changed(preset("ideal"), exposure_s=0.02)
    with pytest.raises(ValueError, match="exposure_s: 0.02 is longer than a frame, 0.01 s"):
        Shot(
            radiance=np.ones((1, 2, 2, 1)), bands_nm=[(450.0, 550.0)], sensor=sensor,
            draw=Draw(0, "s", 0, 0.01), following=following,
        )  # fmt: skip
