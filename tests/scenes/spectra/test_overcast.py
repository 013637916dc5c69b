import numpy as np
import pytest

from megalopta.scenes.spectra.overcast import OVERCAST, overcast_share


def two_streams(single_scattering_albedo, thickness, asymmetry, layers=3000):
    """Share let through by a layer, added up of thin ones (two diffuse streams)."""
    step = thickness / layers
    back = np.sqrt(3) / 2 * single_scattering_albedo * (1 - asymmetry) * step
    lost = np.sqrt(3) * (1 - single_scattering_albedo) * step
    through, reflected = 1.0, 0.0
    for _ in range(layers):
        multiple = 1 / (1 - reflected * back)
        through, reflected = (
            through * multiple * (1 - back - lost),
            back + (1 - back - lost) ** 2 * reflected * multiple,
        )
    return through


@pytest.mark.parametrize(("wavelength_nm", "absorption_cm"), [(1600.0, 6.7), (1200.0, 1.04)])
def test_color_is_that_of_a_layer_added_up_of_thin_ones(wavelength_nm, absorption_cm):
    absorbed = 0.85 * 100 * absorption_cm * 8e-6
    clear, wet = (two_streams(1 - each, 30.0, 0.86) for each in (0.0, absorbed))
    # thin layers of a hundredth of the thickness at which light turns back
    assert OVERCAST(wavelength_nm) == pytest.approx(wet / clear, rel=0.01)


def test_clouds_are_gray_where_the_eye_sees():
    assert OVERCAST(np.arange(380, 780)).min() > 0.99


def test_closed_clouds_let_a_quarter_through_and_none_all():
    assert overcast_share(1.0) == 0.25
    assert overcast_share(0.0) == 1
