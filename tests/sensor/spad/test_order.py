import numpy as np
import pytest

from megalopta import sensor as sensors

SHAPE = (10, 10)
BANDS = [(440.0, 460.0)]
FIELDS = list(sensors.ORDER_OF_EFFECTS)


@pytest.fixture(scope="module")
def all_on(tmp_path_factory):
    folder, rng = tmp_path_factory.mktemp("maps"), np.random.default_rng(0)
    maps = {
        "dark_counts": rng.uniform(0, 500, SHAPE),
        "efficiency": rng.uniform(0.8, 1.2, SHAPE),
        "breakdown": rng.normal(0, 0.04, SHAPE),
    }
    for name, values in maps.items():
        np.save(folder / f"{name}.npy", values)
    return sensors.changed(
        sensors.preset("spadcam"),
        afterpulsing={"mean_carriers": 0.1},
        crosstalk={"mean_fired_neighbors": 0.1},
        filters={"mosaic": ("W",)},
        lag_share=0.1,
        gate={"period_s": 1e-2, "width_s": 5e-3},
        jitter={"sigma_s": 1e-10},
        temperature={"celsius": 0.0},
        tcspc={"bins": 8},
        telegraph={"share": 0.1, "step": 0.05},
        measured={name: str(folder / f"{name}.npy") for name in maps},
    )


@pytest.mark.parametrize("field", FIELDS[1:])
def test_every_effect_can_be_switched_off_alone(all_on, field):
    also = {  # maps in place of drawn patterns, and what then changes nothing
        "dark_counts": {"measured", "telegraph"}, "efficiency": {"measured", "bias"},
        "bias": {"measured"},
    }  # fmt: skip
    alone = sensors.without(all_on, field)
    is_on = [
        bool(getattr(part, "is_on", part))
        for part in (getattr(all_on, field), getattr(alone, field))
    ]
    assert is_on == [True, False]
    different = {name for name in FIELDS if getattr(alone, name) != getattr(all_on, name)}
    assert different == {field} | also.get(field, set())


@pytest.mark.parametrize("field", ["lens", "measured", "afterpulsing", "counter"])
def test_sensor_runs_with_any_effect_off_and_counts_scatter_about_their_mean(all_on, field):
    sensor = sensors.without(all_on, field)
    radiance = np.full((10, *SHAPE, 1), 1e-9)
    radiance *= 500 / sensors.detection_rate(radiance, BANDS, sensor).mean()
    exposed = sensors.expose(radiance, BANDS, sensor, seed=0, stream="s", expectation=True)
    means = exposed.expectation.mean_reading.mean()
    # 1000 counts; the mean of simulated laws is good to 0.5 %, the rest is 5 standard errors
    error = exposed.counts.std() / np.sqrt(exposed.counts.size)
    assert abs(exposed.counts.mean() - means) < 0.005 * means + 5 * error


def test_without_efficiency_every_photon_on_the_active_area_is_detected(all_on):
    sensor = sensors.without(all_on, "efficiency")
    rate = sensors.detection_rate(np.full((1, *SHAPE, 1), 1e-9), BANDS, sensor)
    photons = sensors.photon_rate(np.full((1, *SHAPE, 1), 1e-9), BANDS, sensor)
    np.testing.assert_allclose(rate, photons * sensor.fill_factor, rtol=1e-12)
