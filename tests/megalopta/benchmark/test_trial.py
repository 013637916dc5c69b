"""Trials and sweeps as data: what they refuse, what they expand to, and that YAML keeps them.

Trials side by side: the same numbers at any number of workers, and nothing measured twice.
"""

import numpy as np
import pytest
import yaml

from megalopta.benchmark import trial as engine
from megalopta.benchmark.trial import GratingTemplate, Sweep, Trial, load_sweep
from megalopta.core.errors import UserError
from megalopta.flow.benchmark import SearchSettings

from ..small import counting


def written(tmp_path, text):
    path = tmp_path / "sweep.yaml"
    path.write_text(text, "utf-8")
    return path


def test_sweep_is_every_size_value_and_template():
    gratings = tuple(GratingTemplate(cycles_per_frame=f) for f in (3, 5))
    sweep = Sweep(vary="search.dark_counts", values=(0.1, 10), sizes=(60, 120), templates=gratings)
    found = [
        (trial.size, trial.search.dark_counts, trial.template.cycles_per_frame)
        for trial in sweep.trials
    ]
    assert found == [(n, dark, f) for n in (60, 120) for dark in (0.1, 10) for f in (3, 5)]


def test_sweep_survives_yaml(tmp_path):
    sweep = Sweep(vary="template.contrast", values=(0.1, 0.9), sizes=(60, 240))
    assert load_sweep(written(tmp_path, yaml.safe_dump(sweep.model_dump(mode="json")))) == sweep


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("vary: template.contrst", r"template.contrst: unknown key; did you mean 'contrast'\?"),
        ("values: [0, 1]", "velocity_px 0: no motion, so the errors of BM"),
        ("values: [1, 1]", "values: 1 is named twice"),
        ("values: []", "empty; give at least one"),
        ("trial: {methods: BM}", "trial.methods: give a list, got 'BM'"),
        ("trial: {template: {kind: panorama, name: open, contrast: 1}}", "the keys are coding"),
        ("{vary: template.cycles_per_frame, values: [50]}", "use at most 21.21, or a larger size"),
        ("{vary: size, values: [15, 60]}", "frames of 15 × 15 px cannot be cut"),
        ("{vary: methods, values: [BM, IM]}", "vary: methods cannot vary within a figure"),
        ("{vary: size, values: [60, 120], sizes: [60]}", "sizes: size is varied already"),
        (
            "{vary: template.contrast, values: [0.5],"
            " templates: [{kind: grating}, {kind: grating, contrast: 0.4}]}",
            "duplicate trial: template.contrast is varied",
        ),
    ],
)
def test_impossible_parameters_are_refused_in_one_sentence(tmp_path, text, sentence):
    with pytest.raises(UserError, match="no such sweep; give a YAML file"):
        load_sweep(tmp_path / "absent.yaml")
    with pytest.raises(UserError, match=sentence) as error:
        load_sweep(written(tmp_path, text))
    assert "\n" not in str(error.value)


def test_code_that_a_file_names_is_run_only_where_that_is_allowed(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    canary = tmp_path / "canary"
    text = f"import pathlib\npathlib.Path({str(canary)!r}).touch()\ndef flow(first, second): ..."
    (tmp_path / "named_in_a_file.py").write_text(text)
    named = "[named_in_a_file:flow, LK]"
    path = written(tmp_path, f"trial: {{methods: {named}}}")
    for overrides in ({}, {"trial.size": "20"}):
        with pytest.raises(UserError, match=r"trial\.methods: .*by --allow-code"):
            load_sweep(path, overrides)
    assert not canary.exists()
    allowed = load_sweep(path, allows_code=True)
    typed = load_sweep(written(tmp_path, "{}"), {"trial.methods": named})
    for sweep in (allowed, typed):
        assert [each.name for each in sweep.trial.detectors] == ["named_in_a_file:flow", "LK"]


def test_pictures_are_found_from_the_folder_of_the_sweep_and_typed_ones_from_here(tmp_path):
    folder = tmp_path / "folder"
    folder.mkdir()
    path = written(
        folder,
        "trial: {template: {kind: panorama, name: woods.png}}\n"
        "templates: [{kind: panorama, name: hills/hill.exr}, {kind: panorama, name: open}]",
    )
    sweep = load_sweep(path, {"trial.seed": "1"})
    assert sweep.trial.template.name == str(folder / "woods.png")
    assert [each.name for each in sweep.templates] == [str(folder / "hills" / "hill.exr"), "open"]
    varied = "trial: {template: {kind: panorama, name: open}}\nvary: template.name\n"
    points = load_sweep(written(folder, f"{varied}values: [woods.png, dense]")).points
    assert [point.template for point in points] == [str(folder / "woods.png"), "dense"]
    typed = {"trial.template.kind": "panorama", "trial.template.name": "woods.png"}
    assert load_sweep(written(tmp_path, "{}"), typed).trial.template.name == "woods.png"


FAST = SearchSettings(flux_min=1e4, flux_max=1e7, bits=(2,), metrics=("literal",), phases=2)
TRIALS = Sweep(trial=Trial(search=FAST, methods=("BM", "NDS", "IM")), values=(3, 4, 5)).trials
TEMPLATES = {GratingTemplate(): GratingTemplate().pixels()}


def run(store, workers=1, trials=TRIALS):
    return engine.run(trials, TEMPLATES, store, workers)


def files(store):
    return {path.name: path.read_bytes() for path in store.glob("*.json")}


def test_results_do_not_depend_on_workers(tmp_path):
    alone = run(tmp_path / "alone")
    together = run(tmp_path / "together", 3, TRIALS[::-1])
    assert together == alone
    assert files(tmp_path / "alone") == files(tmp_path / "together")


def test_a_killed_run_goes_on_where_it_stopped(tmp_path, monkeypatch):
    complete = run(tmp_path / "whole")
    measured, real = [], engine.measure_trial
    monkeypatch.setattr(engine, "measure_trial", counting(real, measured, 3))
    with pytest.raises(KeyboardInterrupt):
        run(tmp_path / "killed")
    assert len(files(tmp_path / "killed")) == 2
    measured.pop()  # the third was not done
    monkeypatch.setattr(engine, "measure_trial", counting(real, measured))
    assert run(tmp_path / "killed") == complete
    assert len(measured) == len({trial for trial, *_ in measured}) == 3


def test_a_result_is_not_used_for_another_trial_other_pixels_or_other_code(tmp_path, monkeypatch):
    calls = []
    monkeypatch.setattr(engine, "measure_trial", lambda trial, *_: calls.append(trial) or ())
    run(tmp_path, trials=TRIALS[:1])
    run(tmp_path, trials=[TRIALS[0].model_copy(update={"seed": 1})])
    monkeypatch.setitem(TEMPLATES, GratingTemplate(), np.ones((251, 251)))
    run(tmp_path, trials=TRIALS[:1])
    monkeypatch.setattr(engine, "code_digest", lambda *modules: "of other code")
    run(tmp_path, trials=TRIALS[:1])
    assert len(calls) == 4


@pytest.mark.parametrize("content", [b"\xff", b'{"curves": [{}]}'])
def test_a_damaged_record_is_measured_again(tmp_path, content):
    complete = run(tmp_path, trials=TRIALS[:1])
    (path,) = tmp_path.glob("*.json")
    whole = path.read_bytes()
    path.write_bytes(content)
    assert run(tmp_path, trials=TRIALS[:1]) == complete
    assert path.read_bytes() == whole
