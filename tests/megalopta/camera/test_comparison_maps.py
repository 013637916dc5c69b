"""Maps of the comparison report show what the tests saw."""

import numpy as np
import pytest

from megalopta.camera.comparison import Compared
from megalopta.camera.device_comparison import write_comparison_report
from megalopta.sensor.compare.quantities import CountedFrames
from megalopta.sensor.compare.recordings import compare_recordings


@pytest.mark.slow
def test_a_row_that_differs_is_counted_and_both_maps_share_a_scale(tmp_path):
    rng = np.random.default_rng(3)
    one, other = rng.poisson(20.0, (2, 200, 8, 8)).astype(float)
    one[:, 2] += 10
    levels = [CountedFrames(one, 0.01)], [CountedFrames(other, 0.01)]
    found = compare_recordings(*levels)
    page = tmp_path / "page.html"
    write_comparison_report(page, "camera", Compared(*levels, found))
    html = page.read_text("utf-8")
    # 10 counts are 22 standard errors of a mean
    assert found.means.differs[0, 2].all()
    assert f"Of 64 pixels {found.means.differs.sum()} differ in the mean" in html
    assert f"the mean differs in {found.means.differs.sum()} of 64 pixels" in html
    assert html.count("captured less simulated (standard errors)") == 4  # title and description
