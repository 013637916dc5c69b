"""What scenes are made of, and what is refused."""

import math

import numpy as np
import pytest
import trimesh

from megalopta.scenes import Haze, MovingObject, Scene, ToneCurve, preview
from megalopta.scenes.material import Material, Texture
from megalopta.scenes.moving_objects import with_objects
from megalopta.scenes.spectra.spectrum import Spectrum, flat

BOX = trimesh.creation.box((1, 1, 1))


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


@pytest.mark.parametrize("visibility_m", [30.0, 4000.0])
def test_two_percent_of_a_beam_are_left_at_the_visibility(visibility_m):
    haze = Haze(visibility_m=visibility_m)
    left = math.exp(-haze.extinction_per_m * visibility_m)
    assert left == pytest.approx(0.02)
    assert haze.extinction_per_m == pytest.approx(3.912 / visibility_m, rel=1e-5)  # Koschmieder


EMPTY = Scene({}, {}, ())


def test_objects_stand_where_they_are_put_and_turn_as_told():
    thing = MovingObject(size_m=(4, 2, 1), position_m=(10, 20, 30), turn_deg=(0, 0, 90))
    scene = with_objects(EMPTY, (thing,))
    (placement,) = scene.placements
    (mesh,) = scene.assets[placement.asset].parts.values()
    corners = mesh.vertices @ placement.to_world[:3, :3].T + placement.to_world[:3, 3]
    np.testing.assert_allclose(corners.min(axis=0), [9, 18, 29.5], atol=1e-12)
    np.testing.assert_allclose(corners.max(axis=0), [11, 22, 30.5], atol=1e-12)
    assert placement.motion is None


def test_an_object_spins_about_its_own_center_while_it_drifts():
    thing = MovingObject.model_validate(
        {"position_m": (1, 2, 3), "motion": {"velocity_m_s": (1, 0, -1), "spin_deg_s": 90}}
    )
    motion = with_objects(EMPTY, (thing,)).placements[0].motion
    center, corner = motion.carry(np.array([[1.0, 2, 3], [2, 2, 3]]), 1.0)
    np.testing.assert_allclose(center, [2, 2, 2], atol=1e-12)
    np.testing.assert_allclose(corner, [2, 3, 2], atol=1e-12)  # +x has become +y


BANDS = ((450.0, 550.0), (550.0, 650.0))


def shade_and_sky():
    """Radiance of things in the shade before a sky a hundred times as bright."""
    rng = np.random.default_rng(1)
    radiance = 1e-9 * rng.lognormal(0, 0.8, (40, 50, 1)) * np.ones(2)
    radiance[:12] = 1e-7
    return radiance.astype(np.float32)


def test_nothing_but_the_brightest_clips_and_order_is_kept():
    radiance = shade_and_sky()
    image = preview(radiance, BANDS, flat(1.0))
    assert image[12:].max() < 250
    assert (image[:12] == 255).all()
    values = radiance[..., 0].ravel()
    gray = image[..., 1].ravel().astype(int)
    assert (np.diff(gray[np.argsort(values)]) >= 0).all()
    # Nor is it left in the dark: half of the shade is above 60 of 255.
    assert np.median(gray[values < 5e-8]) > 60


def test_dark_values_stay_as_they_are_and_an_even_picture_too():
    curve = ToneCurve(level=2.0, brightest=300.0)
    np.testing.assert_allclose(curve(np.array([2e-3, 0.02])), [1e-3, 0.01], rtol=0.02)
    assert curve(np.array([300.0, 400.0])).tolist() == [1, 1]
    even = ToneCurve(level=2.0, brightest=2.0)
    np.testing.assert_allclose(even(np.array([0.5, 1.0, 2.0])), [0.25, 0.5, 1.0])
