"""A CTIA array as the image sensor of a rendered scene under airglow, through all stages."""

import numpy as np
import pytest
import zarr

from megalopta.config.model import load, parse
from megalopta.report.page import write_report
from megalopta.stages.run import run_all
from megalopta.stages.sense import STAGE, open_exposure

from ..small import small

pytestmark = pytest.mark.slow

SMALL = small(24, 20, 12) | {
    "name": "night",
    "scene.trees": "6",
    "scene.density_per_ha": "60",
    "scene.undergrowth": "0",
    "scene.detail": "0.1",
    "methods": "[NDS, BM]",
    "benchmark.sizes": "[20]",
    "benchmark.fluxes_per_decade": "1",
    "benchmark.repeats": "2",
}


@pytest.fixture(scope="module")
def night(tmp_path_factory):
    return run_all(tmp_path_factory.mktemp("night") / "data", load("airglow", SMALL))


def test_store_holds_electrons_that_say_so(night):
    settings = night.configuration
    group = zarr.open_group(night.counts(settings.sensors[0], "airglow"), mode="r")
    assert group["counts"].attrs["unit"] == "electrons per exposure"
    assert group["mean_reading"].attrs["unit"] == "mean electrons per exposure"
    assert group["counts"].dtype == np.float32
    assert group.attrs["sensor"]["kind"] == "ctia"
    assert open_exposure(night, settings.sensors[0], "airglow").sensor == settings.sensors[0]


def test_report_speaks_of_electrons(night):
    text = write_report(night).read_text("utf-8")
    assert "From light to electrons" in text
    assert "Dark electrons" in text and "Expected electrons" in text


def test_a_band_outside_the_diodes_curve_is_refused_by_name():
    with pytest.raises(ValueError, match=r"400–500 nm reaches outside the efficiency curve"):
        STAGE.check(parse("sensors: [ctia_ingaas]", "x"))
