import pytest

from megalopta.report.remarks import rendering, rendering_errors


def measured(relative, **more):
    photons = 1 / relative**2 if relative else None
    return {
        "monte_carlo": {
            "median_relative": relative,
            "rms_over_mean": 0.12,
            "equivalent_photons_per_pixel": photons,
            **more,
        }
    }


@pytest.mark.parametrize(("relative", "caution"), [(0.05, False), (0.1, False), (0.11, True)])
def test_more_than_a_tenth_is_a_caution(relative, caution):
    text = rendering(measured(relative), "So.")
    assert f"as noisy as {1 / relative**2:.3g} photons per pixel" in text
    assert ("Caution" in text) == caution


def test_errors_on_surfaces_and_in_the_sky_are_told_apart():
    surface = {"rms": 0.06, "p95": 0.2, "gradient": 0.04, "standing": 0.02}
    surface["standing_gradient"] = 0.01
    record = measured(0.05, surface=surface, sky={"rms": 0.001})
    record["light_left_out"] = [0.01, 0.3]
    texts = [text.replace("\u00a0", " ") for _, text in rendering_errors(record)]
    assert texts == ["12 %", "6.0 %", "20 % or less", "4.0 %", "2.0 %", "1.0 %", "0.10 %", "30 %"]
