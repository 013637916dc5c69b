import numpy as np
import pytest

from megalopta.sensor import PRESETS, Sensor, preset
from megalopta.sensor.afterpulsing import Afterpulsing
from megalopta.sensor.analog_counter import AnalogCounter
from megalopta.sensor.bias import Bias
from megalopta.sensor.counter import DigitalCounter
from megalopta.sensor.crosstalk import Crosstalk
from megalopta.sensor.dark_counts import DarkCounts
from megalopta.sensor.dead_time import DeadTime
from megalopta.sensor.efficiency import Efficiency
from megalopta.sensor.gating import Gate
from megalopta.sensor.jitter import Jitter
from megalopta.sensor.measured import MapFile, MeasuredMaps
from megalopta.sensor.optics import Lens
from megalopta.sensor.presets import TABLE_2_1
from megalopta.sensor.temperature import Temperature

MODELS = [
    *(Sensor, Lens, Efficiency, Bias, Temperature, DarkCounts, MapFile, MeasuredMaps, Gate),
    *(DeadTime, Afterpulsing, Crosstalk, Jitter, DigitalCounter, AnalogCounter),
]


@pytest.mark.parametrize("model", MODELS)
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


@pytest.mark.parametrize("name", TABLE_2_1)
def test_devices_of_the_literature_have_the_printed_figures(name):
    sensor, device = preset(name), TABLE_2_1[name]
    area_um2 = sensor.active_area_m2 / 1e-12
    assert area_um2 == pytest.approx(device.active_area_um2)
    density = sensor.dark_counts.bulk_mean_hz_um2
    assert density * area_um2 == pytest.approx(device.dark_counts_hz)
    assert density == pytest.approx(device.density_hz_um2, rel=0.025)  # printed with two digits
    assert max(sensor.efficiency.values) == device.peak_efficiency
    assert sensor.bias.excess_v == device.excess_bias_v


def test_spadcam_counts_as_its_device_sheet_says():
    sensor = preset("spadcam")
    assert sensor.counter_capacity == 320
    assert sensor.counter.leak_v_s == 7.2e-3
    assert sensor.bias.breakdown_sigma_v == 0.042


def test_short_form_of_a_saturating_counter_is_understood():
    values = preset("ideal").model_dump(exclude={"counter"}) | {"counter_capacity": 255}
    assert Sensor.model_validate(values).counter == DigitalCounter(capacity=255)


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
