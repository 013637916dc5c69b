"""How the entries of a plan are dealt out to its sequences."""

import pytest

from megalopta.config.drawing import configuration_of
from megalopta.config.recipe import Plan
from megalopta.scenes.levels import LEVELS

LIGHTS = ("twilight", "full_moon", "starlight", "daylight")


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("cameras", [0, 2, 3])
def test_each_entry_comes_once_before_one_comes_again(seed, cameras):
    per_path = max(cameras, 1)
    scenes = tuple({"preset": "grating", "scene": {"contrast": share}} for share in (0.2, 0.4, 0.6))
    rig = tuple({"position_m": [0.1 * place, 0, 0]} for place in range(cameras))
    plan = Plan(sequences=12 * per_path, seed=seed, scenes=scenes, lights=LIGHTS, rig=rig)
    made = [configuration_of(plan, index) for index in range(12 * per_path)]
    for camera in range(per_path):
        of_camera = made[camera::per_path]
        for first in range(0, 12, 3):
            assert {each.scene.contrast for each in of_camera[first : first + 3]} == {0.2, 0.4, 0.6}
        for first in range(0, 12, 4):
            assert {each.light.level for each in of_camera[first : first + 4]} == {*LIGHTS}
    assert [each.scene for each in made] == [
        made[i // per_path * per_path].scene for i in range(len(made))
    ]


def test_a_longer_plan_begins_with_the_same_sequences():
    short, long = (Plan(sequences=n, scenes=("grating",), lights=tuple(LEVELS)) for n in (3, 30))
    assert [configuration_of(short, i) for i in range(3)] == [
        configuration_of(long, i) for i in range(3)
    ]
