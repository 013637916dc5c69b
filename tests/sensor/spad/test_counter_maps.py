"""Maps of the counters of one device take the place of drawn ones."""

import numpy as np
import pytest

from megalopta.sensor import MapFile, MeasuredMaps, changed, preset
from megalopta.sensor.spad.device import draw_fixed_pattern


@pytest.mark.parametrize(
    ("name", "field", "times"),
    [("step", "step_v", 1), ("leak", "leaked_v", 0.5), ("offset", "offset_v", 1)],
)
def test_a_map_is_what_the_counters_have(tmp_path, name, field, times):
    values = np.linspace(5e-3, 2e-2, 12).reshape(3, 4)
    np.save(tmp_path / "map.npy", values)
    maps = MeasuredMaps(**{name: MapFile(path=str(tmp_path / "map.npy"))})
    sensor = changed(preset("spadcam"), measured=maps, exposure_s=0.5)
    counters = draw_fixed_pattern(sensor, (3, 4)).counters
    np.testing.assert_allclose(getattr(counters, field), times * values)


def test_a_step_of_nothing_is_refused(tmp_path):
    np.save(tmp_path / "map.npy", np.zeros((3, 4)))
    maps = MeasuredMaps(step=MapFile(path=str(tmp_path / "map.npy")))
    with pytest.raises(ValueError, match=r"measured\.step"):
        draw_fixed_pattern(changed(preset("spadcam"), measured=maps), (3, 4))
