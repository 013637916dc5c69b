"""Events by time and place, and codes of an ADC, against the counts of the same light."""

from collections.abc import Iterator

import numpy as np

from megalopta.sensor import changed
from megalopta.sensor.counters import AnalogCounter, counts_of_codes
from megalopta.sensor.readout import expose_events, histogram
from megalopta.sensor.selfcheck.comparison import Row, exact_row, mean_row, variance_row
from megalopta.sensor.spad import draw_fixed_pattern, expose_adc, preset, reading_moments

_SHAPE = 40, 50


def check_places() -> Iterator[Row]:
    """Frame, row and column of events, in frames of their own brightness at every pixel."""
    sensor = preset("ideal")
    light = np.arange(3 * 40 * 50, dtype=np.float64).reshape(3, *_SHAPE) / 100
    events = expose_events(light / sensor.exposure_s, sensor, seed=8, sequence="e", first_frame=7)
    found = np.zeros(light.shape)
    np.add.at(found, (events.frame - 7, events.row, events.column), 1)
    off = float(np.abs(found - histogram(events)).max())
    yield exact_row("event stream", "largest difference of its histograms", 0, off, 1e-9)
    y, x = np.indices(_SHAPE)
    for name, place in (("frame", np.arange(3)[:, None, None]), ("row", y), ("column", x)):
        due = float((light * place).sum())
        z = ((found - light) * place).sum() / (light * place**2).sum() ** 0.5
        yield Row("event stream", f"sum of each {name}", due, float((found * place).sum()), z)


def check_adc() -> Iterator[Row]:
    """Codes of frames drawn one by one and together, turned into counts."""
    counter = AnalogCounter(step_v=0.03, step_sigma_v=1e-3, leak_v_s=0.1, adc_bits=12)
    sensor = changed(preset("ideal"), counter=counter)
    known = draw_fixed_pattern(sensor, _SHAPE).counters
    assert known is not None
    rate = np.tile(np.linspace(100, 400, 20)[:, None, None], (1, *_SHAPE))
    mean, variance = reading_moments(rate, sensor)
    for together in (1, 3):
        codes = expose_adc(rate, sensor, seed=8, sequence="adc", together=together)
        z = (counts_of_codes(codes, counter, known)[0] - mean) / np.sqrt(variance)
        term = f"codes, {together} at once"
        yield mean_row(term, "mean, in standard deviations", 0.0, z)
        yield variance_row(term, "variance, over that stated", 1.0, z)
