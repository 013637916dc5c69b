"""How rays are shared between the sides of a surface, and what they count."""

import numpy as np
import pytest

from megalopta.render.baking.gathering import Scattering
from megalopta.scenes.material import Emission, Material, Texture
from megalopta.scenes.spectra.spectrum import Spectrum, flat

BANDS = ((400.0, 500.0), (700.0, 900.0))
RISING = Spectrum((400.0, 900.0), (0.0, 0.5))
WEIGHT = np.zeros((2, 2), np.float32)
MATERIALS = {
    "opaque": Material(RISING),
    "leaf": Material(RISING, Texture(WEIGHT, flat(0.4), flat(0.3)), transmittance=RISING),
    "little comes through": Material(flat(0.9), transmittance=flat(0.01)),
    "glows": Material(flat(0.5), None, Emission(1.0), flat(0.5)),
    "black": Material(flat(0.0)),
}
SCATTERING = Scattering(list(MATERIALS.values()), BANDS)
INDEX = {name: index for index, name in enumerate(MATERIALS)}


def test_rays_go_through_where_light_does_and_neither_side_is_starved():
    through = dict(zip(MATERIALS, SCATTERING.through, strict=True))
    assert through["opaque"] == through["glows"] == through["black"] == 0
    assert through["little comes through"] == 0.25
    # Means over both spectra and both bands.
    means = [RISING(np.linspace(*band, 1001)).mean() for band in BANDS]
    back, on = (np.mean([*means, other, other]) for other in (0.4, 0.3))
    assert through["leaf"] == pytest.approx(on / (back + on), rel=1e-3)


@pytest.mark.parametrize("name", MATERIALS)
def test_what_rays_count_makes_up_for_how_many_there_are(name):
    material, share = MATERIALS[name], SCATTERING.through[INDEX[name]]
    counted = SCATTERING.of_rays()[INDEX[name]]
    expected = [material.reflectance, material.transmittance or flat(0.0)]
    if material.emission:
        expected = [flat(0.0), flat(0.0)]
    for side, spectrum in enumerate(expected):
        mean = (share if side else 1 - share) * counted[side, 0].mean(axis=-1)
        found = [spectrum(np.linspace(*band, 1001)).mean() for band in BANDS]
        np.testing.assert_allclose(mean, found, 1e-6, 1e-12)


def test_brightness_counts_the_light_of_both_sides():
    bright = dict(zip(MATERIALS, SCATTERING.brightness(flat(2.0)), strict=True))
    assert bright["glows"] == bright["black"] == 0 and bright["little comes through"] == 1
    assert bright["leaf"] > bright["opaque"] > 0
    assert (SCATTERING.brightness(flat(0.0)) == 1).all()
