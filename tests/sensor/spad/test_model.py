import numpy as np
import pytest
from pydantic import BaseModel

from megalopta import sensor as sensor_package
from megalopta.sensor import CTIA_PRESETS, DigitalCounter, changed, preset
from megalopta.sensor.effects.bias import efficiency_factor
from megalopta.sensor.spad.presets import TABLE_2_1

MODELS = [
    model
    for model in vars(sensor_package).values()
    if isinstance(model, type) and issubclass(model, BaseModel)
]


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.__name__)
def test_every_parameter_is_documented(model):
    assert [name for name, field in model.model_fields.items() if not field.description] == []


def test_spadcam_follows_its_device_sheet():
    sensor = preset("spadcam")
    assert sensor.active_area_m2 == pytest.approx(360e-12)
    assert sensor.pixel_area_m2 == pytest.approx(3600e-12)
    assert sensor.dead_time.kind == "paralyzable"
    assert sensor.counter.capacity == 320
    # below 1 % in every pixel at every bias, as far as it was measured and beyond
    at_high_bias = changed(sensor.bias, excess_v=3.0)
    assert max(sensor.efficiency.values) * efficiency_factor(at_high_bias, 0.0) < 0.01
    # all pixels of a row count at 13.40 V, the lowest bias measured
    assert sensor.bias.onset_v <= 1.0 - 3 * sensor.bias.breakdown_sigma_v
    peak = sensor.efficiency.wavelengths_nm[int(np.argmax(sensor.efficiency.values))]
    assert peak == 450


@pytest.mark.parametrize("name", TABLE_2_1)
def test_devices_of_the_literature_have_the_printed_figures(name):
    sensor, row = preset(name), TABLE_2_1[name]
    area_um2 = sensor.active_area_m2 / 1e-12
    density = sensor.dark_counts.bulk_mean_hz_um2
    assert density * area_um2 == pytest.approx(row["dark_hz"])
    assert density == pytest.approx(row["density_hz_um2"], rel=0.025)  # printed with two digits


def test_gate_that_never_opens_is_refused():
    late = {"period_s": 1.0, "width_s": 0.1, "phase_s": 0.5}
    with pytest.raises(ValueError, match=r"gate: it does not open in an exposure_s of 0\.1; lower"):
        changed(preset("ideal"), gate=late)
    assert changed(preset("ideal"), gate=late, exposure_s=0.6).gate.phase_s == 0.5


def test_named_fields_change_and_the_rest_stays():
    spadcam = preset("spadcam")
    slower = changed(spadcam, exposure_s=0.02, counter={"step_v": 0.03})
    assert (slower.exposure_s, slower.counter.step_v) == (0.02, 0.03)
    assert changed(slower, exposure_s=spadcam.exposure_s, counter=spadcam.counter) == spadcam


def test_another_kind_starts_afresh():
    assert changed(preset("spadcam"), counter={"kind": "digital"}).counter == DigitalCounter()


def test_parts_and_sensors_that_integrate_change_alike():
    assert changed(preset("spadcam").bias, excess_v=1.3).excess_v == 1.3
    assert changed(CTIA_PRESETS["ctia_si"], bias={"kind": "fixed"}).bias.kind == "fixed"
