"""How the entries of a plan are dealt out to its sequences."""

from itertools import product

import pytest

from megalopta.config.drawing import configuration_of, plan_warnings, split_of
from megalopta.config.model import load
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


def test_exposures_are_the_plans_and_not_a_presets():
    assert load("demo").correct
    assert not configuration_of(Plan(), 0).correct
    assert configuration_of(Plan(every={"correct": True}), 0).correct


def test_paths_that_differ_in_noise_only_are_named_if_splits_share_them():
    turn = {"rotation_deg_s": {"uniform": [5, 30]}}
    for rig, drawn in product(((), ({}, {"position_m": [0.1, 0, 0]})), (True, False)):
        scene = {"preset": "grating", "trajectory": turn if drawn else {}}
        splits = {"train": 0.5, "test": 0.5}
        plan = Plan(sequences=16, scenes=(scene,), splits=splits, sample=0, rig=rig)
        assert {split_of(plan, index) for index in range(16)} == {"train", "test"}
        warnings = list(plan_warnings(plan))
        assert warnings == [] if drawn else "are equal but for noise" in warnings[0]
    (warning,) = plan_warnings(Plan(sequences=1, splits={"a": 1, "b": 1}))
    assert warning.startswith("splits: b get none of the sequences (1); make 2 or more")


@pytest.mark.parametrize("cameras", [0, 2])
def test_any_number_of_first_paths_has_its_shares_to_one(cameras):
    splits, rig = {"train": 0.8, "validation": 0.15, "test": 0.05}, ({},) * cameras
    plan = Plan(sequences=400, splits=splits, rig=rig)
    dealt = [split_of(plan, index) for index in range(400)]
    for paths in (4, 10, 33, 100, 200):
        for name, share in splits.items():
            first = dealt[: paths * max(cameras, 1)][:: max(cameras, 1)]
            assert abs(first.count(name) - paths * share) <= 1
    few = Plan(sequences=4, splits={"train": 3, "val": 1})
    assert sorted(split_of(few, index) for index in range(4)) == ["train"] * 3 + ["val"]
    assert Plan(splits={"a": 1 / 3, "b": 1 / 3, "c": 1 / 3})
    with pytest.raises(ValueError, match=r"sum of shares is 25\.75"):
        Plan(splits={"train": 0.75, "val": 25})


def test_paths_whose_true_motion_repeats_are_told_though_their_scenes_differ():
    forest = {"preset": "demo", "scene": {"seed": {"integer": [0, 9000]}}}
    turning = {**forest, "trajectory": {"rotation_deg_s": {"uniform": [-30, 30]}}}
    for scene, told in ((forest, True), (turning, False)):
        warnings = list(plan_warnings(Plan(sequences=4, scenes=(scene,), splits={"all": 1})))
        assert [text[:32] for text in warnings] == told * ["different motions: 1 in 4 paths,"]
    still = {"trajectory": {"frames": 1}}
    (warning,) = plan_warnings(Plan(sequences=1, every=still, splits={"a": 1}))
    assert warning.startswith("trajectory.frames 1: one frame has no flow")
