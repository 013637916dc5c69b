"""What `sense` writes beside the counts, through the doors that users take."""

import numpy as np
import pytest

from megalopta.sensor import Crosstalk, changed, ctia_preset, preset
from megalopta.sensor.formats.products import check_product
from megalopta.sensor.formats.reading import read_frames
from megalopta.sensor.sampling.streams import Draw
from megalopta.sensor.shot import NextFrames, Shot
from megalopta.stages.sense import open_exposure

from ..small import made

pytestmark = pytest.mark.slow

LEVEL = 1e-5
"""Lux, some ten counts a pixel."""
PRODUCTS = ["counts", "events_hdf5", "events_npz", "binary_npy", "tiff"]


def settings(tiny, **changes):
    values = tiny.model_dump(mode="json") | {"products": PRODUCTS, "light_levels": [LEVEL]}
    return type(tiny).model_validate(values | {"sensors": tiny.sensors[1:]} | changes)


@pytest.fixture(scope="module")
def sensed(tiny, tmp_path_factory):
    return made(tmp_path_factory.mktemp("products") / "data", settings(tiny))


@pytest.fixture
def folder(sensed):
    return sensed.root / "counts" / sensed.sequence


def test_every_product_is_in_the_record(sensed, folder):
    sense = sensed.record.stages["sense"]
    names = {name.split("/")[-1] for name in sense.files if "/counts" in f"/{name}"}
    assert {
        "ideal-1e-05lux.events.h5", "ideal-1e-05lux.events.npz", "ideal-1e-05lux.binary.npy",
        "ideal-1e-05lux.tiff",
    } <= names  # fmt: skip
    assert not [path for path in folder.iterdir() if path.name.startswith(".")]


def test_stack_holds_the_counts(sensed, folder):
    counts = stored(sensed).counts
    found = read_frames(folder / "ideal-1e-05lux.tiff")
    np.testing.assert_array_equal(found.counts, counts)
    assert found.exposure_s == sensed.configuration.sensors[0].exposure_s


def stored(dataset):
    opened = open_exposure(dataset, dataset.configuration.sensors[0], LEVEL)
    return opened.exposure()


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
