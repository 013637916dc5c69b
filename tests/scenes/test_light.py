import math

import numpy as np
import pytest

from megalopta.scenes import Light
from megalopta.scenes.levels import LEVELS
from megalopta.scenes.spectra.spectrum import luminous, planckian

COVERS = (0.1, 0.5, 0.9, 1.0)


def given(light):
    """Lux of a horizontal plane, of the sky's radiance and the disc's irradiance."""
    lighting = light.lighting()
    lux = math.pi * luminous(lighting.sky)
    if lighting.sun:
        lux += luminous(lighting.sun.irradiance) * lighting.sun.direction[2]
    return lux


def parts(light):
    return {each.name: each.illuminance_lux for each in light.resolved().components}


@pytest.mark.parametrize("level", LEVELS)
def test_sky_and_disc_together_give_the_named_illuminance(level):
    assert given(Light(level=level)) == pytest.approx(LEVELS[level].illuminance_lux, rel=1e-12)


def test_disc_and_sky_of_the_moon_share_what_the_night_leaves():
    night = 1e-3
    for fraction in (0.0, 0.3, 1.0):
        light = parts(Light(level="full_moon", disc_fraction=fraction))
        assert light.get("moon", 0) == pytest.approx(fraction * (0.25 - night))
        assert light["airglow"] + light["starlight"] == pytest.approx(night)
    assert Light(level="full_moon", disc_fraction=0.0).lighting().sun is None


def test_a_color_temperature_is_that_of_every_light():
    light = Light(level="full_moon", color_temperature_k=5000).lighting()
    grid = np.arange(400, 1700, 50)
    for spectrum in (light.sky, light.sun.irradiance):
        ratio = spectrum(grid) / planckian(5000)(grid)
        np.testing.assert_allclose(ratio, ratio[0])


@pytest.mark.parametrize("cover", COVERS)
def test_clouds_take_what_kasten_and_czeplak_measured_and_their_share_of_the_disc(cover):
    clear, light = Light(level="daylight"), Light(level="daylight", cloud_cover=cover)
    assert given(light) == pytest.approx(1e5 * (1 - 0.75 * cover**3.4))
    sun = parts(light).get("sun", 0)
    assert sun == pytest.approx((1 - cover) * parts(clear)["sun"])


def test_clouds_take_more_of_the_infrared():
    def ratio(cover):
        light = Light(level="starlight", cloud_cover=cover).resolved().spectrum()
        return light(1450) / light(550)

    ratios = [ratio(cover) for cover in (0.0, *COVERS)]
    assert ratios == sorted(ratios, reverse=True)
    assert ratios[-1] < 0.5 * ratios[0]


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"level": "twilight", "disc_fraction": 0.5}, "disc_fraction 0.5: .* no disc; .*use one"),
        ({"level": "overcast_night", "cloud_cover": 0.5}, "cloud_cover 0.5: .* already overcast"),
        *(({"illuminance_lux": lux}, "illuminance_lux") for lux in (1e308, 1e-300, 0, -1)),
        ({"panorama": ..., "sky": "natural"}, "sky 'natural': a panorama has its own sky and disc"),
        (
            {"panorama": ..., "disc_fraction": 0.5},
            r"disc_fraction 0\.5: a panorama has its own sky",
        ),
        (
            {"panorama": {"path": "a.jpg", "sha256": "0" * 64}},
            r"a\.jpg is not an HDR, EXR or PNG file",
        ),
    ],
)
def test_what_does_not_fit_is_refused_with_a_remedy(picture, settings, told):
    path = str(picture(np.ones((8, 16, 3))))
    given = {name: path if value is ... else value for name, value in settings.items()}
    with pytest.raises(ValueError, match=told):
        Light(**given)


def test_disc_direction_is_a_unit_vector_toward_azimuth_and_elevation():
    sun = Light(level="daylight", disc_azimuth_deg=90, disc_elevation_deg=30).lighting().sun
    np.testing.assert_allclose(sun.direction, [0, math.cos(math.pi / 6), 0.5], atol=1e-12)
