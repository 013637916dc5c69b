import pytest

from megalopta.sensor import DigitalCounter, changed, ctia_preset, preset


def test_named_fields_change_and_the_rest_stays():
    spadcam = preset("spadcam")
    other = changed(spadcam, exposure_s=0.02, counter={"step_v": 0.03})
    assert (other.exposure_s, other.counter.step_v) == (0.02, 0.03)
    assert changed(other, exposure_s=spadcam.exposure_s, counter=spadcam.counter) == spadcam


def test_another_kind_starts_afresh():
    assert changed(preset("spadcam"), counter={"kind": "digital"}).counter == DigitalCounter()


def test_parts_and_sensors_that_integrate_change_alike():
    assert changed(preset("spadcam").bias, excess_v=1.3).excess_v == 1.3
    assert changed(ctia_preset("ctia_si"), bias={"kind": "fixed"}).bias.kind == "fixed"


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"exposur_s": 1}, "exposur_s: unknown key; did you mean 'exposure_s'?"),
        ({"exposure_s": -1}, "exposure_s: input should be greater than 0, got -1"),
    ],
)
def test_a_mistake_is_one_sentence(fields, said):
    with pytest.raises(ValueError) as refusal:
        changed(preset("spadcam"), **fields)
    assert str(refusal.value) == said
