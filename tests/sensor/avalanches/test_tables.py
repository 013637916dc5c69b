"""Simulated moments on disk: the same numbers from a file, without a folder, and after damage."""

import importlib

import numpy as np
import pytest

from megalopta.sensor.avalanches import tables
from megalopta.sensor.effects.afterpulsing import Afterpulsing
from megalopta.sensor.effects.dead_time import DeadTime
from megalopta.sensor.effects.fields import AvalancheEffects

EFFECTS = AvalancheEffects(
    dead_time=DeadTime(kind="nonparalyzable", dead_time_s=1e-6),
    afterpulsing=Afterpulsing(mean_carriers=0.1, delay_s=2e-6),
)


@pytest.fixture
def after_a_start(tmp_path, monkeypatch):
    """Ratios at 10 arrivals as a program finds them that has just started, and what it computed."""
    monkeypatch.setattr("megalopta.core.folders.user_cache_path", lambda *_, **__: tmp_path)

    def start():
        computed = []

        def law(rates):
            computed.append(rates)
            return rates * 1e-4, rates * 1e-4

        fresh = importlib.reload(tables)  # nothing in memory
        return fresh.moment_ratios(np.array([8]), 1e-4, EFFECTS, law), len(computed)

    return start


def test_a_table_is_made_once_and_again_when_damaged(tmp_path, after_a_start):
    made, computed = after_a_start()
    assert computed == 1
    read, computed = after_a_start()
    assert computed == 0
    np.testing.assert_array_equal(read, made)
    (file,) = (tmp_path / "moments").glob("*.npz")
    whole = file.read_bytes()
    for damaged in (whole[: len(whole) // 2], whole.replace(made[0].tobytes(), bytes(16)), b""):
        assert damaged != whole
        file.write_bytes(damaged)
        again, computed = after_a_start()
        assert computed == 1
        np.testing.assert_array_equal(again, made)


def test_without_a_folder_to_write_to_the_numbers_are_the_same(tmp_path, after_a_start):
    (tmp_path / "moments").write_text("a file is in the way")
    nowhere, computed = after_a_start()
    assert computed == 1
    (tmp_path / "moments").unlink()
    np.testing.assert_array_equal(after_a_start()[0], nowhere)
