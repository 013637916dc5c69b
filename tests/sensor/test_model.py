import numpy as np
import pytest

from megalopta.sensor import PRESETS, Sensor, preset
from megalopta.sensor.dark_counts import DarkCounts
from megalopta.sensor.dead_time import DeadTime
from megalopta.sensor.efficiency import Efficiency
from megalopta.sensor.optics import Lens


@pytest.mark.parametrize("model", [Sensor, Lens, Efficiency, DarkCounts, DeadTime])
def test_every_parameter_is_documented(model):
    assert [name for name, field in model.model_fields.items() if not field.description] == []


@pytest.mark.parametrize("name", PRESETS)
def test_preset_survives_json(name):
    sensor = preset(name)
    assert sensor.name == name
    assert sensor.source
    assert Sensor.model_validate_json(sensor.model_dump_json()) == sensor


def test_spadcam_follows_its_device_sheet():
    sensor = preset("spadcam")
    assert sensor.active_area_m2 == pytest.approx(360e-12)
    assert sensor.pixel_area_m2 == pytest.approx(3600e-12)
    assert sensor.dead_time.kind == "paralyzable"
    assert max(sensor.efficiency.values) < 0.01
    peak = sensor.efficiency.wavelengths_nm[int(np.argmax(sensor.efficiency.values))]
    assert peak == 450


def test_ideal_sensor_differs_from_spadcam_only_as_a_device():
    ideal, spadcam = preset("ideal"), preset("spadcam")
    for shared in ("pitch_m", "exposure_s", "lens"):
        assert getattr(ideal, shared) == getattr(spadcam, shared)


def test_unknown_preset_is_refused_with_the_known_ones():
    with pytest.raises(ValueError, match=r"'kodak'.*ideal, spadcam"):
        preset("kodak")


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("exposure_s", -1),
        ("exposure_s", 0),
        ("pitch_m", float("inf")),
        ("fill_factor", 1.01),
        ("counter_capacity", 0),
        ("counter_capacity", 2**32),
        ("name", ""),
        ("exposure", 1),
    ],
)
def test_impossible_or_unknown_parameter_is_refused_by_name(field, value):
    with pytest.raises(ValueError, match=field):
        Sensor.model_validate(preset("ideal").model_dump() | {field: value})
