"""The search against the full lattice, closed forms, and its independence of the way."""

import numpy as np
import pytest

from megalopta.assets_gen.grating import sine_grating
from megalopta.flow import METHODS, BenchmarkSettings, SearchSettings, photon_benchmark
from megalopta.flow.benchmark_search import next_index, photon_search
from megalopta.flow.stimuli.moving_template import MovingTemplate

ALL = tuple(METHODS[name] for name in ("BM", "IIA", "EMD", "NDM", "NDS", "IM"))


def grating(contrast=0.9, cycles=5, size=60, velocity=5, variant="rot"):
    x = np.arange(251) / 251
    pattern = sine_grating(x[None], x[:, None], contrast, cycles, (0, 0), variant)
    return MovingTemplate(pattern, velocity, size)


def found(stimulus, *names, seed=0, name="grating", **changes):
    settings = SearchSettings(**({"metrics": ("literal",), "bits": (2,)} | changes))
    return photon_search(stimulus, [METHODS[each] for each in names], settings, seed, name)


def fluxes(curves, bits=2):
    return [curve.thresholds[bits].flux for curve in curves]


@pytest.mark.parametrize(
    ("size", "bits", "expected"), [(60, 2, 36_480), (240, 2, 583_675), (60, 4, 162.9 * 3600)]
)
def test_intensity_of_a_flat_image_meets_the_closed_form(size, bits, expected):
    flat = MovingTemplate(np.ones((251, 251)), 5, size)
    (curve,) = found(flat, "IM", dark_counts=0, bits=(bits,))
    assert curve.thresholds[bits].flux == pytest.approx(expected, rel=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["BM", "IIA", "EMD", "NDM", "NDS"])
def test_search_finds_the_crossing_of_the_full_lattice(name):
    # Other frames, other draws, warmed up with noise instead of clean frames: the standard errors
    # of 251 frames and of 40 are below 4 % (BM) and 1 % (others); phases differ by 5 to 12 %.
    # Of the lattice, what lies within a factor of 1.6: a crossing elsewhere is none here.
    stimulus = grating(cycles=5, velocity=5)
    (searched,) = fluxes(found(stimulus, name))
    settings = BenchmarkSettings(
        sizes=(60,),
        metrics=("literal",),
        bits=(2,),
        repeats=2,
        flux_min=searched / 1.6,
        flux_max=searched * 1.6,
        fluxes_per_decade=8,
    )
    frames = np.stack([np.roll(stimulus.template, 5 * t, axis=1) for t in range(281)])
    full = photon_benchmark(frames, [METHODS[name]], settings, 0, "grating").curves[0]
    assert searched == pytest.approx(full.thresholds[2].flux, rel=0.12)


def test_required_flux_goes_as_contrast_to_the_power_of_minus_two():
    contrasts = np.array([0.2, 0.8])
    found_fluxes = [
        fluxes(found(grating(contrast), "IIA", "EMD", "NDM", "NDS", dark_counts=0))
        for contrast in contrasts
    ]
    slopes = np.polyfit(np.log(contrasts), np.log(np.array(found_fluxes, float)), 1)[0]
    np.testing.assert_allclose(slopes, -2, atol=0.1)


@pytest.mark.parametrize(
    ("name", "tolerance_db"), [("IIA", 0.8), ("EMD", 0.2), ("NDM", 0.2), ("NDS", 0.2)]
)
def test_errors_fall_by_10_db_per_decade_above_threshold(name, tolerance_db):
    # 20 log10 of the error over log10 of the flux, from 6 to 8 bits. Standard errors are 0.1 dB
    # (IIA, still 0.13 dB above the limit there) and 0.03 dB.
    (curve,) = found(grating(), name, bits=(6, 8), dark_counts=0)
    six, eight = curve.thresholds[6].flux, curve.thresholds[8].flux
    assert 20 * np.log10(2**2) / np.log10(eight / six) == pytest.approx(10, abs=tolerance_db)


def test_block_matching_below_0_7_px_per_frame_is_undefined():
    (curve,) = found(grating(velocity=2), "BM")  # 0.48 px per frame
    assert curve.thresholds[2].kind == "undefined"
    assert all(np.isnan(curve.errors))
    (defined,) = found(grating(velocity=3), "BM")  # 0.72 px per frame
    assert defined.thresholds[2].kind == "crossing"


def test_results_do_not_depend_on_the_company_of_methods():
    together = found(grating(), *(method.name for method in ALL), metrics=("literal", "ratio"))
    for method in ALL:
        alone = found(grating(), method.name, metrics=("literal", "ratio"))
        assert alone == tuple(curve for curve in together if curve.method == method.name)


@pytest.mark.parametrize(("per_decade", "is_smooth"), [(1, False), (3, True), (8, False)])
def test_search_ends_on_any_falling_curve(per_decade, is_smooth):
    rng = np.random.default_rng(2)
    for _ in range(60):
        curve = np.sort(rng.lognormal(-1, 3, 19))[::-1]
        errors, index = {}, int(rng.integers(19))
        while index is not None:
            assert index not in errors
            errors[index] = curve[index]
            index = next_index(errors, 0.25, 18, per_decade, 0.0, is_smooth)
        below = [i for i in range(19) if curve[i] < 0.25]
        assert not below or min(below) in errors
        assert below[:1] in ([], [0]) or min(below) - 1 in errors
