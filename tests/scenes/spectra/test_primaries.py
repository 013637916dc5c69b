import numpy as np
import pytest

from megalopta.scenes.lighting.levels import LEVELS
from megalopta.scenes.spectra.color import LUMINANCE_SHARES, primaries
from megalopta.scenes.spectra.photometry import luminous


@pytest.mark.parametrize("level", LEVELS)
def test_primaries_add_up_to_the_light_and_share_its_luminance_as_srgb_does(level):
    light = LEVELS[level].spectrum()
    spectra = primaries(light)
    grid = np.array(spectra[0].wavelengths_nm)
    # On the primaries' own grid nothing is interpolated: float64 rounding is all that remains.
    np.testing.assert_allclose(sum(each(grid) for each in spectra), light(grid), rtol=1e-12)
    total = sum(map(luminous, spectra))
    np.testing.assert_allclose(
        [luminous(each) / total for each in spectra], LUMINANCE_SHARES, atol=1e-9
    )
    # Corners of the light's table between the grid's points.
    assert total == pytest.approx(LEVELS[level].illuminance_lux, rel=2e-3)
