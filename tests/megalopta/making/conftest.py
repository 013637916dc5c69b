import pytest

from megalopta.plan import Plan

SMALL = {
    "camera": {"width": 32, "height": 24},
    "render": {
        "samples_per_pixel": 1,
        "max_depth": 2,
        "bands_nm": [[700, 800], [800, 900]],
        "integrator": "path",
    },
}


@pytest.fixture(scope="session")
def small_plan():
    """Boards and gratings that take a second each."""
    return Plan(
        sequences=3,
        seed=3,
        scenes=(
            {"preset": "grating", "trajectory": {"rotation_deg_s": {"uniform": [5, 20]}}},
            {
                "preset": "grating",
                "scene": {"kind": "plane"},
                "trajectory": {"kind": "hover", "look_at_m": [1, 0, 1.5]},
            },
        ),
        lights=("daylight", "twilight"),
        every={**SMALL, "trajectory": {"frames": 3}},
        sensors=("spadcam", "ctia_si"),
        light_levels=({"log_uniform": [0.1, 10]},),
    )


@pytest.fixture(scope="session")
def full_plan():
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
        every={**SMALL, "trajectory": {"frames": 20}},
        sensors=("spadcam", "ctia_si"),
        light_levels=("twilight", "full_moon"),
    )
