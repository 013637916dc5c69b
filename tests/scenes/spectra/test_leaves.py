import numpy as np
import pytest

from megalopta.core import strict_yaml
from megalopta.scenes.spectra.prospect import TOLERANCE, computed, tabulated
from megalopta.scenes.spectra.reflectance import LEAVES, TABLE, leaf_of

WAVELENGTHS_NM = np.arange(380, 2501)
ENTRIES = strict_yaml.load(TABLE.read_text("utf-8"))


@pytest.mark.parametrize("name", LEAVES)
def test_leaves_send_out_less_light_than_they_get(name):
    reflected, through = (spectrum(WAVELENGTHS_NM) for spectrum in leaf_of(name))
    assert reflected.min() > 0.02 and through.min() >= 0
    assert (reflected + through).max() < 0.98


def test_a_darker_leaf_is_darker_on_both_sides():
    for whole, half in zip(leaf_of("moss"), leaf_of("moss * 0.5"), strict=True):
        np.testing.assert_allclose(half(WAVELENGTHS_NM), whole(WAVELENGTHS_NM) / 2, 1e-12)


def test_leaves_absorb_as_green_dry_and_young_ones_do():
    absorbed = {
        name: 1 - sum(spectrum([550, 670, 900]) for spectrum in leaf_of(name)) for name in LEAVES
    }
    for name in set(LEAVES) - {"dry leaf"}:
        green, red, infrared = absorbed[name]
        assert 0.35 < green < 0.85 and red > 0.8 and infrared < 0.2, name
    assert absorbed["young leaf light"][0] < absorbed["leaf light"][0] < absorbed["leaf dark"][0]
    assert absorbed["dry leaf"][1] < 0.3  # no chlorophyll


@pytest.mark.parametrize("name", LEAVES)
def test_tables_are_what_the_model_gives_for_the_parameters_beside_them(name):
    pytest.importorskip("xleaf")
    entry = ENTRIES[name]
    assert {key: entry[key] for key in entry if key != "prospect"} == tabulated(entry["prospect"])
    wavelengths, curves = computed(entry["prospect"])
    for spectrum, curve in zip(leaf_of(name), curves, strict=True):
        np.testing.assert_allclose(spectrum(wavelengths), curve, atol=TOLERANCE + 0.0005)
