"""A dataset of a plan: made, extended, refused, measured, and exposed to new light."""

import numpy as np
import pytest
import yaml

import megalopta
from megalopta.cli import main
from megalopta.config.drawing import configuration_of
from megalopta.config.recipe import Plan
from megalopta.core.errors import UserError
from megalopta.dataset.store import Tree, hashes_of
from megalopta.sensor import open_counts
from megalopta.stages import make as module
from megalopta.stages.make import add_exposures, make, measure, parse_indices
from megalopta.verification.files import check_files

from ..small import content, copied


def run(*words):
    main.main([*map(str, words)])


def written(folder, plan, changes=()):
    path = folder / "plan.yaml"
    path.write_text(yaml.safe_dump(plan.model_dump(mode="json") | dict(changes)))
    return path


def without_books(root):
    books = {"dataset.yaml", "timings.json", "croissant.json"}
    return {
        str(path.relative_to(root)): path.read_bytes()
        for path in root.rglob("*")
        if path.is_file()
        and path.name not in books
        and path.parts[len(root.parts)] not in ("index", "splits")
    }


def test_one_sequence_alone_is_that_of_the_whole(small_plan, small_dataset, tmp_path, capsys):
    plan = written(tmp_path, small_plan)
    run("dataset", "make", plan, "--out", tmp_path / "alone", "--only", "1", "--sequences", "1000")
    alone, whole = without_books(tmp_path / "alone"), without_books(small_dataset)
    assert len(alone) > 50
    assert alone == {name: each for name, each in whole.items() if "000001" in name}
    assert Tree(tmp_path / "alone").names() == ["000001"]
    faults = check_files(Tree(tmp_path / "alone"))
    assert ["999 sequences of the plan are missing" in fault.fault for fault in faults] == [True]


def test_more_sequences_leave_what_is_there(small_copy, small_plan):
    before = without_books(small_copy)
    make(small_copy, small_plan.model_copy(update={"sequences": 4}))
    after = without_books(small_copy)
    assert {name: after[name] for name in before} == before
    assert Tree(small_copy).names() == [f"00000{n}" for n in range(4)]
    assert not check_files(Tree(small_copy), truths=4)


def test_another_plan_is_refused_with_the_difference(small_copy, small_plan):
    for changes, told in (
        ({"seed": 4}, "seed: 3 → 4"),
        ({"lights": ("daylight",)}, "lights"),
        ({"repeats": 2}, "repeats: 1 → 2"),
    ):
        with pytest.raises(UserError, match=told):
            make(small_copy, small_plan.model_copy(update=changes))


def test_an_exposure_of_this_name_with_other_settings_is_refused(small_copy, refused):
    level = megalopta.open_dataset(small_copy)[0].configuration.light_levels[0]
    told = refused(
        "sense", small_copy, "--sensors", "{preset: spadcam, exposure_s: 0.01}",
        "--light-levels", level,
    )  # fmt: skip
    assert "give the sensor another name" in told


def test_repeats_of_a_plan_are_of_one_device(small_plan, tmp_path):
    plan = small_plan.model_copy(update={"sequences": 1, "repeats": 2, "sensors": ("spadcam",)})
    tree = make(tmp_path / "data", plan)
    stores = sorted((tree.root / "counts/000000").iterdir())
    first, second = (open_counts(store) for store in stores)
    np.testing.assert_array_equal(first["mean_reading"][:], second["mean_reading"][:])
    assert (first["counts"][:] != second["counts"][:]).any()


def test_mistakes_are_told_before_anything_is_made(small_plan, tmp_path, refused):
    for change, told in (
        ({"scenes": ["dmeo"]}, "scenes: 0: preset 'dmeo' is unknown"),
        ({"every": {"camera": {"width": {"uniform": [5, 1]}}}}, "give the lower number first"),
        ({"every": {"camera": {"widht": 5}}}, "did you mean 'width'"),
        ({"lights": ["moon"]}, "light.level"),
        ({"splits": {"a b": 1}}, "cannot name a split"),
        ({"lights": [{"illuminance_lux": {"uniforn": [1, 2]}}]}, "did you mean uniform"),
        ({"sensors": ["swissspad2"], "every": {"correct": True}}, "`every: {correct: false}`"),
    ):
        plan = written(tmp_path, small_plan, change)
        said = refused("dataset", "make", plan, "--out", tmp_path / "data")
        assert told in said
        assert not (tmp_path / "data").exists()


def test_every_kind_of_range_is_drawn_within_its_limits():
    from megalopta.config.drawing import split_of

    plan = Plan(
        scenes=({"preset": "grating", "trajectory": {"rotation_deg_s": {"uniform": [5, 20]}}},),
        every={"camera": {"width": {"integer": [10, 12]}, "height": {"one_of": [8, 16]}}},
        light_levels=({"log_uniform": [0.001, 10]},),
    )
    drawn = [configuration_of(plan, index) for index in range(60)]
    rates = [each.trajectory.rotation_deg_s for each in drawn]
    assert 5 <= min(rates) < 8
    assert 17 < max(rates) <= 20
    assert {each.camera.width for each in drawn} == {10, 11, 12}
    assert {each.camera.height for each in drawn} == {8, 16}
    levels = np.log10([each.light_levels[0] for each in drawn])
    # uniform over four decades: the mean of 60 has a standard error of 0.15, six of which are 0.9
    assert abs(levels.mean() + 1) < 0.9
    assert len({each.seed for each in drawn}) == 60
    assert {split_of(plan, index) for index in range(200)} == set(plan.splits)


def test_numbers_of_sequences():
    assert parse_indices("7, 0-2", 10) == [0, 1, 2, 7]
    for text, told in (("3-x", "'3-x'"), ("12", "0 to 9"), ("5-3", "0 to 9")):
        with pytest.raises(UserError, match=told):
            parse_indices(text, 10)


def test_a_sequence_that_fails_is_told_and_the_same_command_tries_it_again(
    small_copy, small_plan, monkeypatch
):
    measured = module.sequence_statistics

    def failing(dataset):
        if dataset.sequence == "000003":
            raise ValueError("no luck")
        return measured(dataset)

    more = small_plan.model_copy(update={"sequences": 5})
    with monkeypatch.context() as patched:
        patched.setattr(module, "sequence_statistics", failing)
        with pytest.raises(UserError, match="1 of 2 sequences failed, such as 000003: .*no luck"):
            make(small_copy, more)
    assert Tree(small_copy).names()[-1] == "000004"
    make(small_copy, more)
    assert not check_files(Tree(small_copy))


@pytest.mark.slow
def test_the_share_of_light_is_told_and_that_new_sequences_lack_exposures(
    single_copy, single_plan, capsys
):
    run("sense", single_copy, "--sensors", "ideal")
    make(single_copy, single_plan.model_copy(update={"sequences": 2}))
    told = capsys.readouterr().err
    assert "`megalopta sense` added exposures to earlier sequences" in told
    sequence = megalopta.open_dataset(single_copy)[0]
    spadcam, ideal = sequence.dataset.record.exposures
    # pixels differ in dark counts and in what they lose: the means of 192 pixels, 2 frames
    dark = sequence.expose("spadcam", 1e-12)[:].mean()
    assert spadcam.light_fraction == pytest.approx(1 - dark / spadcam.mean_reading, rel=0.05)
    assert "light among all counts, SNR of a pixel: spadcam-twilight 2" in told
    assert ideal.light_fraction == 1
    assert ideal.snr == pytest.approx(ideal.mean_reading**0.5, rel=0.01)


METHODS = {"methods": "[BM]"}


@pytest.mark.slow
def test_flow_of_many_is_that_of_each_and_the_same_by_workers(small_dataset, tmp_path):
    roots = [tmp_path / name for name in ("here", "workers")]
    for root, more in zip(roots, ([], ["--workers", "2"]), strict=True):
        copied(small_dataset, root)
        run("flow", root, "--methods", "[BM]", *more)
        assert not check_files(Tree(root))
    assert flows(roots[0]) == flows(roots[1]) != {}


def flows(root):
    return {
        name: digest
        for name, digest in hashes_of(root, [root / "results"]).items()
        if not name.endswith("timings.json")
    }


def test_a_measurement_is_kept_refused_redone_and_mended(small_copy):
    measure(small_copy, "flow", METHODS)
    before, paths = flows(small_copy), list(small_copy.rglob("results/**/*"))
    times = [path.stat().st_mtime_ns for path in paths]
    measure(small_copy, "flow", METHODS)
    assert [path.stat().st_mtime_ns for path in paths] == times
    with pytest.raises(UserError, match=r"holds flow output of another .*methods.* add --redo"):
        measure(small_copy, "flow", {"methods": "[LK]"})
    for redo in (False, True):
        with pytest.raises(UserError, match=r"width: 32 → 40"):
            measure(small_copy, "flow", {"camera.width": "40"}, redo)
    measure(small_copy, "flow", {"methods": "[LK]"}, redo=True)
    assert flows(small_copy) != before
    measure(small_copy, "flow", METHODS, redo=True)
    path = small_copy / "results/000000/flow.json"
    path.write_text(path.read_text("utf-8").replace("BM", "MB"), "utf-8")
    measure(small_copy, "flow", METHODS)
    assert flows(small_copy) == before
    assert not check_files(Tree(small_copy))


@pytest.mark.slow
def test_a_plan_goes_on_after_flow_by_methods_that_it_does_not_state(small_copy, small_plan):
    measure(small_copy, "flow", {"methods": "[DIS]"})
    (small_copy / "splits/sample/KittiFlow/training/image_2/000000-0001_10.png").unlink()
    assert len(check_files(Tree(small_copy))) == 1
    make(small_copy, small_plan)
    assert not check_files(Tree(small_copy))


@pytest.mark.slow
def test_new_light_on_old_frames(small_copy, small_dataset):
    words = ("sense", small_copy, "--sensors", "ideal", "--light-levels", "0.5", "starlight")
    run(*words, "--repeats", "2")
    added = set(without_books(small_copy)) - set(without_books(small_dataset))
    assert {name.split("/")[0] for name in added} == {"counts"}
    sequence = megalopta.open_dataset(small_copy)[2]
    assert sequence.exposures[2:] == (
        *("ideal-0.5lux", "ideal-starlight", "ideal-r2-0.5lux", "ideal-r2-starlight"),
    )
    first, second = (sequence.counts(f"ideal{r}-0.5lux")[:].astype(float) for r in ("", "-r2"))
    mean = sequence.counts("ideal-0.5lux", "mean_reading")[:]
    # independent Poisson noise: correlation of 2304 pixels below 6 / sqrt(2304), P < 1e-6
    noise = [(each - mean).ravel() / np.sqrt(mean.ravel() + 1e-9) for each in (first, second)]
    assert abs(np.corrcoef(*noise)[0, 1]) < 6 / np.sqrt(len(noise[0]))
    assert not check_files(Tree(small_copy))
    before = without_books(small_copy)
    run(*words, "--repeats", "2")
    assert without_books(small_copy) == before


NEW_LIGHT = {"sensors": "[spadcam]", "light_levels": "[twilight, full_moon]"}


def test_corrected_frames_of_new_exposures_are_on_record_and_others_stay(single_plan, tmp_path):
    calibration = {"frames": 2, "hot_times": 10}
    plan = single_plan.model_copy(
        update={"every": {**single_plan.every, "correct": True, "calibration": calibration}}
    )
    make(tmp_path, plan)
    before = hashes_of(tmp_path, [tmp_path / "corrected"])
    killed = tmp_path / "counts/000000/spadcam-full_moon.zarr"
    killed.mkdir()  # as a run that was killed leaves it
    add_exposures(tmp_path, NEW_LIGHT)
    assert not check_files(Tree(tmp_path))
    after = hashes_of(tmp_path, [tmp_path / "corrected"])
    assert before.items() < after.items() and before
    (sequence,) = megalopta.open_dataset(tmp_path)
    assert sequence.corrected("spadcam-full_moon")[0].shape == sequence.shape


def test_exposures_by_another_sensor_model_are_refused(single_copy, monkeypatch):
    before = content(single_copy)
    monkeypatch.setattr("megalopta.stages.sense.SENSOR_MODEL", 99)
    with pytest.raises(UserError, match=r"another sensor model .*sense: model: \d+ → 99"):
        add_exposures(single_copy, NEW_LIGHT)
    assert content(single_copy) == before


def test_more_sequences_of_another_model_are_refused(single_copy, single_plan, monkeypatch):
    monkeypatch.setattr("megalopta.stages.render.RENDER_MODEL", 99)
    make(single_copy, single_plan)  # nothing is missing, and nothing is mixed
    with pytest.raises(UserError, match=r"000000 was made by other software .*render: model: .*99"):
        make(single_copy, single_plan.model_copy(update={"sequences": 2}))


def test_other_verbs_take_many_too(small_copy, capsys, refused):
    run("report", small_copy)
    assert capsys.readouterr().out.split() == [
        str(small_copy / name) for name in ("README.md", "index.html")
    ]
    run("dataset", "make", small_copy, "--out", small_copy, "--sequences", "4")
    assert len(Tree(small_copy).names()) == 4
    assert not check_files(Tree(small_copy))
    assert "a dataset of 4 sequences, and this takes one" in refused("check", "truth", small_copy)
    told = refused("render", small_copy, "--out", small_copy, "--redo")
    assert "remove a sequence's record to make it again" in told
