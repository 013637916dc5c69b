"""A device against itself, and against devices that differ in one thing."""

from dataclasses import replace

import numpy as np
import pytest

from .cameras import against, camera, recorded


@pytest.fixture(scope="module")
def reference():
    return recorded(seed=1)


@pytest.fixture(scope="module")
def other():
    return recorded(seed=2)


@pytest.mark.slow
def test_a_device_against_itself_raises_alarms_at_the_stated_rate():
    pairs = ((recorded(1000 + 2 * at), recorded(1001 + 2 * at)) for at in range(200))
    # at 1 %, 13 or more of 200 have a chance of 2e-7
    assert sum(bool(against(*pair).alarms) for pair in pairs) < 13


@pytest.mark.parametrize(
    ("name", "changed"),
    [
        ("dark counts", {"dark": 1.2}),
        ("efficiency", {"efficiency": 1.2}),
        ("step", {"step": 1.2}),
        ("dead time", {"sensor": camera(dead_time_s=1.2e-6)}),
    ],
)
def test_a_fifth_more_is_named(name, changed, reference):
    found = against(recorded(seed=2, **changed), reference)
    (cause,) = found.causes
    assert cause.name == name
    assert cause.relative == pytest.approx(0.2, abs=0.06)
    assert name in found.sentence
    assert found.alarms


@pytest.mark.slow
def test_doubled_crosstalk_is_named():
    more, less = (
        recorded(seed=seed, sensor=camera(crosstalk=share)) for seed, share in ((5, 0.1), (6, 0.05))
    )
    found = against(more, less, camera(crosstalk=0.05))
    (cause,) = found.causes
    assert cause.name == "crosstalk"
    assert cause.relative == pytest.approx(1, abs=0.2)


@pytest.mark.parametrize(
    ("words", "move"),
    [
        ("transposed", lambda counts: counts.transpose(0, 2, 1)),
        ("rows in reverse order", lambda counts: counts[:, ::-1]),
        ("columns in reverse order", lambda counts: counts[:, :, ::-1]),
        ("turned by 90° to the left", lambda counts: np.rot90(counts, axes=(1, 2))),
        ("2 of 16 rows in another order", lambda counts: counts[:, [1, 0, *range(2, 16)]]),
        ("16 of 16 rows", lambda counts: counts[:, np.arange(16) ^ 1]),
    ],
)
def test_another_order_of_pixels_is_named(words, move, reference, other):
    moved = [replace(level, readings=move(level.readings)) for level in other]
    found = against(moved, reference)
    assert words in found.sentence
    assert found.alarms


@pytest.mark.slow
def test_small_differences_are_equivalent_though_beyond_chance():
    levels = ((0.02, 0.0),)
    many = [
        recorded(seed, frames=4000, dark=dark, levels=levels)
        for seed, dark in ((3, 1.02), (4, 1.0))
    ]
    found = against(*many)
    (dark,) = (each for each in found.differences if each.name == "dark counts")
    assert dark.is_equivalent
    assert not found.causes


def test_too_few_frames_are_refused(reference):
    few = [replace(level, readings=level.readings[:30]) for level in reference]
    with pytest.raises(ValueError, match="30 frames"):
        against(few, reference)
