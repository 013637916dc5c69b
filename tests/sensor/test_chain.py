import numpy as np
import pytest

from megalopta.sensor import (
    ORDER_OF_EFFECTS,
    Afterpulsing,
    Crosstalk,
    Gate,
    Jitter,
    MapFile,
    MeasuredMaps,
    Sensor,
    Temperature,
    expose_rate,
    preset,
    without,
)
from megalopta.sensor.chain import describe

ALL_ON = preset("spadcam").model_copy(
    update={
        "afterpulsing": Afterpulsing(mean_carriers=0.1),
        "crosstalk": Crosstalk(probability=0.1),
        "gate": Gate(period_s=1e-2, width_s=5e-3),
        "jitter": Jitter(sigma_s=1e-10),
        "temperature": Temperature(celsius=0.0),
        "measured": MeasuredMaps(dark_counts=MapFile(path="x.npy")),
    }
)
NO_EFFECT = {"kind", "name", "source", "pitch_m", "fill_factor", "exposure_s", "device_seed"}


def test_list_names_every_effect_of_a_sensor_once():
    fields = [effect.field for effect in ORDER_OF_EFFECTS]
    assert len(set(fields)) == len(fields)
    assert set(fields) == set(Sensor.model_fields) - NO_EFFECT


@pytest.mark.parametrize("effect", ORDER_OF_EFFECTS[1:], ids=lambda effect: effect.field)
def test_every_effect_can_be_switched_off_alone(effect):
    assert effect.is_on(ALL_ON)
    others = [other for other in ORDER_OF_EFFECTS if other is not effect]
    reduced = without(ALL_ON, effect.field)
    assert not effect.is_on(reduced)
    assert all(other.is_on(reduced) for other in others)


@pytest.mark.parametrize(
    "field", ["afterpulsing", "crosstalk", "gate", "dead_time", "dark_counts", "counter"]
)
def test_sensor_runs_with_any_effect_off_and_counts_scatter_about_their_mean(field):
    sensor = without(without(ALL_ON, "measured"), field)
    rate = np.full((30, 10, 10), 500.0)
    exposure = expose_rate(rate, sensor, seed=0, sequence="s")
    means = exposure.expected.mean()
    # 3000 counts; the mean of simulated laws is good to 0.5 %, the rest is 5 standard errors
    error = exposure.counts.std() / np.sqrt(exposure.counts.size)
    assert abs(exposure.counts.mean() - means) < 0.005 * means + 5 * error


def test_description_lists_what_is_on_in_order():
    assert len(describe(ALL_ON)) == len(ORDER_OF_EFFECTS)
    assert [line.split(":")[0] for line in describe(preset("ideal"))] == ["lens"]


def test_unknown_effect_is_refused_with_the_known_ones():
    with pytest.raises(ValueError, match="'noise': no such effect; choose from lens, efficiency"):
        without(ALL_ON, "noise")
