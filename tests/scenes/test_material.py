import numpy as np
import pytest

from megalopta.scenes.material import Emission, Material, Texture
from megalopta.scenes.spectra.spectrum import Spectrum, flat

WEIGHT = np.zeros((2, 2), np.float32)


def test_surfaces_that_would_send_out_more_light_than_they_get_are_refused():
    rising, falling = (Spectrum((400.0, 700.0), ends) for ends in ((0.2, 0.8), (0.7, 0.1)))
    Material(rising, transmittance=falling)
    peak = Spectrum((400.0, 550.0, 700.0), (0.0, 0.6, 0.0))
    with pytest.raises(ValueError, match=r"material: .* add up to 1.1 at 550 nm; scale"):
        Material(rising, transmittance=peak)
    with pytest.raises(ValueError, match=r"texture: .* add up to 1.2 at 400 nm"):
        Texture(WEIGHT, flat(0.5), falling)
    with pytest.raises(ValueError, match=r"add up to 1.5 at 550 nm"):
        Material(flat(1.5))


def test_light_comes_through_where_either_spectrum_lets_it():
    half = flat(0.5)
    assert not Material(half).transmits
    assert not Material(half, Texture(WEIGHT, half), transmittance=flat(0.0)).transmits
    assert Material(half, transmittance=half).transmits
    assert Material(half, Texture(WEIGHT, half, half)).transmits
    assert not Material(half, None, Emission(1.0), half).transmits
