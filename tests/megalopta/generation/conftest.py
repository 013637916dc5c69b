from pathlib import Path

import pytest

from megalopta.config.recipe import Plan


@pytest.fixture(scope="session")
def full_plan(small_plan):
    """Three kinds of scene, three lights, two sensors, 20 sequences of 20 frames."""
    return Plan(
        sequences=20,
        seed=4,
        scenes=(
            {"preset": "demo", "scene": {"trees": {"integer": [6, 12]}}},
            {"preset": "grating", "trajectory": {"rotation_deg_s": {"uniform": [5, 20]}}},
            {
                "preset": "grating",
                "scene": {"kind": "plane", "pattern": "dots"},
                "trajectory": {"kind": "hover", "look_at_m": [1, 0, 1.5]},
            },
        ),
        lights=("daylight", "twilight", "full_moon"),
        every={**small_plan.every, "trajectory": {"frames": 20}},
        sensors=("spadcam", "ctia_si"),
        light_levels=("twilight", "full_moon"),
    )


@pytest.fixture
def jobs(monkeypatch):
    """The module of jobs, which worker processes find, too."""
    folder = str(Path(__file__).parent)
    monkeypatch.setenv("PYTHONPATH", folder)
    monkeypatch.syspath_prepend(folder)
    import jobs_of_tests

    return jobs_of_tests
