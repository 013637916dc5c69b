"""One axis for all lights, exposures and speeds: texture scales in closed form, and misfits."""

import numpy as np
import pytest

from megalopta.benchmark.ranked_sequence import RankedSequence
from megalopta.benchmark.ranking import ranking_rows
from megalopta.benchmark.ranking_settings import Pooling, RankingSettings
from megalopta.benchmark.sequence_errors import TEXTURE
from megalopta.benchmark.table import Case, Sums
from megalopta.benchmark.transfer import AXES, Curve, common_curve, misfits
from megalopta.flow.detectors.blocks import block_grid

PERIOD_PX, CONTRAST = 16, 0.6
PHOTONS = np.logspace(-1, 3, 5)


@pytest.mark.parametrize("pooled", [1, 2])
def test_the_texture_scale_of_a_grating_has_a_closed_form(pooled, tmp_path):
    """The mean of (c·cos)²/(1 + c·sin) is 1 − √(1 − c²), and the grating has half of both axes."""
    phase = 2 * np.pi * (np.arange(96) + 0.5) / PERIOD_PX
    pooled_contrast = CONTRAST * np.sinc(pooled / PERIOD_PX) / np.sinc(1 / PERIOD_PX)
    grating = np.tile(1 + CONTRAST * np.sin(phase), (2, 96, 1))
    sequence = RankedSequence(None, None, {}, tmp_path, print)
    sequence.__dict__["_light"] = grating
    grid = block_grid((96 // pooled, 96 // pooled), PERIOD_PX // pooled)
    found = sequence.texture_px(grid, Pooling(pooled, 1))
    slope = (2 * np.pi / PERIOD_PX) ** 2 * (1 - np.sqrt(1 - pooled_contrast**2))
    # the spline through 8 samples of a period errs by some 1e-3 of its slope
    np.testing.assert_allclose(found, np.sqrt(2 / slope), rtol=5e-3)


def test_a_group_that_is_mostly_without_light_has_no_texture_scale():
    scales = {"dark": [np.inf, np.inf, 3.0], "lit": [np.inf, 2.0, 3.0]}
    parts = {
        Case(TEXTURE, "light", 1e3, group): Sums(np.array(each), np.ones(3))
        for group, each in scales.items()
    }
    found = ranking_rows([parts], RankingSettings(methods=("BM",)), {})
    assert [(row.group, row.value) for row in found] == [("lit", 3.0)]


def curves(power):
    """Return curves that fall on one along n·φ^power, of different motions."""
    motions = {("low", 1): 0.1, ("high", 1): 1.0, ("high", 2): 2.0}
    return [
        Curve(speed, frames, motion, PHOTONS, (PHOTONS * motion**power) ** -0.5)
        for (speed, frames), motion in motions.items()
    ]


@pytest.mark.parametrize("power", AXES.values())
def test_curves_that_fall_on_one_have_no_misfit_on_their_axis_alone(power):
    found = misfits(curves(power))
    assert {AXES[name] for name, each in found.items() if each.value < 1e-9} == {power}
    # an intercept alone differs: its spread over the curves, on the other axes
    for name, each in found.items():
        shifts = [0.5 * (AXES[name] - power) * np.log10(motion) for motion in (0.1, 1.0, 2.0)]
        assert each.value <= np.std(shifts) + 1e-9 and each.low <= each.value <= each.high + 1e-12


def test_the_common_curve_is_the_power_law_of_its_points():
    common = common_curve(curves(2), 2)
    np.testing.assert_allclose(common(np.array([0.0, 1.0])), [0, -0.5], atol=1e-9)
