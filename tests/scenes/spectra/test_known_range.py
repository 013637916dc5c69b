"""Bands beyond the range of a spectrum are refused, with its name and range."""

import numpy as np
import pytest

from megalopta.config.model import Configuration
from megalopta.config.yaml_model import validated
from megalopta.core.errors import UserError
from megalopta.scenes.levels import LEVELS
from megalopta.scenes.material import Emission, Material, Texture
from megalopta.scenes.scene import Scene
from megalopta.scenes.spectra.reflectance import leaf_of, reflectance_of
from megalopta.scenes.spectra.spectrum import Spectrum, flat


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("band", [(300, 320), (359, 420), (1780, 1801), (3000, 4000)])
def test_bands_in_which_the_light_is_unknown(level, band):
    fields = {
        "light": {"level": level},
        "render": {"bands_nm": [band]},
        "scene": {"kind": "forest"},
    }
    with pytest.raises(UserError, match=rf"light '{level}': .* known from 360 to 1800 nm"):
        validated(Configuration, fields, "a.yaml", {})


SOIL, BLADE = reflectance_of("soil * 1.6"), leaf_of("dry leaf")


@pytest.mark.parametrize(
    ("material", "band", "said"),
    [
        (Material(SOIL), (370, 400), "380 to 1700"),
        (Material(SOIL), (1600, 1750), "380 to 1700"),
        (Material(BLADE.reflectance, transmittance=BLADE.transmittance), (380, 420), "400 to 2500"),
        (Material(flat(0.1), Texture(np.ones((2, 2), "f4"), SOIL)), (1600, 1750), "380 to 1700"),
        (Material(flat(0.0), emission=Emission(Spectrum((500, 600), (1, 2)))), (590, 610), "500 to 600"),
        (Material(flat(0.3), known_nm=(500, 600)), (590, 610), "500 to 600"),
    ],
)  # fmt: skip
def test_bands_in_which_a_surface_is_unknown(material, band, said):
    scene = Scene({"it": material}, {}, ())
    with pytest.raises(
        ValueError, match=f"material 'it': .* known from {said} nm, and bands_nm has"
    ):
        scene.check_bands([(550, 560), band])
    scene.check_bands([(550, 560)])
