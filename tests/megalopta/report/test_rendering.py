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
