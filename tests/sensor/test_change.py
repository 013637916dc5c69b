from megalopta.sensor import CTIA_PRESETS, DigitalCounter, changed, preset


def test_named_fields_change_and_the_rest_stays():
    spadcam = preset("spadcam")
    slower = changed(spadcam, exposure_s=0.02, counter={"step_v": 0.03})
    assert (slower.exposure_s, slower.counter.step_v) == (0.02, 0.03)
    assert changed(slower, exposure_s=spadcam.exposure_s, counter=spadcam.counter) == spadcam


def test_another_kind_starts_afresh():
    assert changed(preset("spadcam"), counter={"kind": "digital"}).counter == DigitalCounter()


def test_parts_and_sensors_that_integrate_change_alike():
    assert changed(preset("spadcam").bias, excess_v=1.3).excess_v == 1.3
    assert changed(CTIA_PRESETS["ctia_si"], bias={"kind": "fixed"}).bias.kind == "fixed"
