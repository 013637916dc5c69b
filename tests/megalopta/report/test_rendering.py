import pytest

from megalopta.report.rendering import render_noise


def measured(relative):
    photons = 1 / relative**2 if relative else None
    return {
        "monte_carlo": {
            "median_relative": relative,
            "rms_over_mean": 0.12,
            "equivalent_photons_per_pixel": photons,
        }
    }


def test_noise_is_told_in_photons_per_pixel():
    noise = render_noise(measured(0.05))
    assert (noise.photons, noise.rms) == ("400", "12\u00a0%")
    assert noise.relative == "5.0\u00a0%"


@pytest.mark.parametrize(("relative", "caution"), [(0.05, False), (0.1, False), (0.11, True)])
def test_more_than_a_tenth_is_a_caution(relative, caution):
    assert render_noise(measured(relative)).caution == caution


@pytest.mark.parametrize("record", [{}, {"monte_carlo": None}, measured(0.0)])
def test_without_a_measurement_or_without_noise_there_is_nothing_to_tell(record):
    assert render_noise(record) is None


def test_what_stands_on_surfaces_and_what_is_in_the_sky_is_told_apart():
    record = measured(0.05)
    region = {"share": 0.5, "rms": 0.06, "median": 0.05, "p95": 0.2, "bands": [0.1]}
    record["monte_carlo"]["surface"] = {
        **region,
        "gradient": 0.04,
        "standing": 0.02,
        "standing_gradient": 0.01,
    }
    record["monte_carlo"]["sky"] = {
        **region,
        "rms": 0.001,
        "gradient": 0.0,
        "standing": 0.0,
        "standing_gradient": 0.0,
    }
    text = render_noise(record).surfaces.replace("\u00a0", " ")
    assert "6.0 % of their mean light (RMS; 20 % or less" in text
    assert "makes 4.0 % of the squared differences" in text
    assert "2.0 % (RMS) is that of baked light" in text
    assert "In the sky it is 0.10 % of the sky's light" in text


@pytest.mark.parametrize(
    ("shares", "told"), [([0.01, 0.3], True), ([0.0, 5e-4], False), (None, False)]
)
def test_light_that_is_left_out_is_told(shares, told):
    text = render_noise({**measured(0.05), "light_left_out": shares}).surfaces
    assert ("30\u00a0% of that of surfaces in the band that loses most" in text) == told
