"""Trials and sweeps as data: what they refuse, what they expand to, and that YAML keeps them."""

import pytest
from pydantic import ValidationError

from megalopta.benchmark.sweep import Sweep, load_sweep
from megalopta.benchmark.templates import GratingTemplate, PanoramaTemplate, template_names
from megalopta.benchmark.trial import Trial
from megalopta.config.yaml_model import to_yaml
from megalopta.core.errors import UserError


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


def test_sweep_of_size_ignores_the_fixed_one():
    assert [trial.size for trial in Sweep(vary="size", values=(60, 180)).trials] == [60, 180]


def test_sweep_survives_yaml(tmp_path):
    sweep = Sweep(vary="template.contrast", values=(0.1, 0.9), sizes=(60, 240))
    assert load_sweep(written(tmp_path, to_yaml(sweep))) == sweep


def test_settings_of_the_command_line_win(tmp_path):
    path = written(tmp_path, "vary: template.contrast\nvalues: [0.5, 0.9]\n")
    sweep = load_sweep(path, {"trial.velocity_px": "3", "values": "[0.2]"})
    assert [(trial.velocity_px, trial.template.contrast) for trial in sweep.trials] == [(3, 0.2)]


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("vary: template.contrst", r"template.contrst: unknown key; did you mean 'contrast'\?"),
        ("vary: nothing.at.all", "vary: nothing.at.all: no field 'nothing'"),
        ("values: [0, 1]", "velocity_px 0: nothing moves, so the errors of BM"),
        ("values: [1.5]", "velocity_px: input should be a valid integer"),
        ("values: [1, 1]", "values: 1 is named twice"),
        ("values: []", "empty; give at least one"),
        ("values: [.nan]", "values.0: input should be a finite number"),
        ("values: 3", "values: give a list, got 3"),
        ("trial: {methods: BM}", "trial.methods: give a list, got 'BM'"),
        ("trial: {template: dense}", "trial.template: give a mapping of keys to values"),
        ("trial: {template: {kind: panorama}}", "trial.template.name: missing"),
        ("trial: {template: {kind: panorama, name: open, contrast: 1}}", "the keys are coding"),
        ("{vary: template.cycles_per_frame, values: [50]}", "use at most 21.21, or a larger size"),
        ("{vary: template.contrast, values: [2]}", "template.contrast: input should be less than"),
        ("trial: {methods: [XY]}", "method 'XY' is unknown"),
        ("{trial: {size: 15}}", "trial: size 15 is too small for BM: frames of 15"),
        ("{vary: size, values: [15, 60]}", "size 15 is too small for BM: frames of 15"),
        ("{trial: {search: {dark_counts: 1.0e+30}}}", "dark_counts: input should be less than"),
        ("{vary: methods, values: [BM, IM]}", "vary: methods is the same for a whole figure"),
        ("{vary: search.metrics, values: [ratio]}", "vary: search.metrics is the same for a"),
        ("{vary: search.bits.0, values: [2]}", "vary: search.bits.0 is the same for a whole"),
        ("{vary: size, values: [60, 120], sizes: [60]}", "sizes: size is varied already"),
        (
            "{vary: template.contrast, values: [0.5],"
            " templates: [{kind: grating}, {kind: grating, contrast: 0.4}]}",
            "two trials are the same: template.contrast is varied",
        ),
        ("sizes: [600]", "size: input should be less than or equal to 251"),
        ("[]", "a mapping of keys to values"),
        ("{", "not valid YAML"),
    ],
)
def test_impossible_parameters_are_refused_in_one_sentence(tmp_path, text, sentence):
    with pytest.raises(UserError, match=sentence) as error:
        load_sweep(written(tmp_path, text))
    assert "\n" not in str(error.value)


def test_gratings_are_named_by_what_they_differ_in():
    gratings = [GratingTemplate(contrast=0.5), GratingTemplate(contrast=0.9, variant="periodic")]
    assert template_names([*gratings, PanoramaTemplate(kind="panorama", name="open")]) == [
        "grating contrast=0.5 variant=rot",
        "grating contrast=0.9 variant=periodic",
        "open",
    ]
    assert template_names(gratings[:1]) == ["grating"]


def test_codings_of_a_panorama_have_names_of_their_own():
    panoramas = [PanoramaTemplate(name="open", coding=coding) for coding in ("linear", "srgb")]
    assert template_names(panoramas) == ["open", "open srgb"]


def test_pictures_are_found_from_the_folder_of_the_sweep(tmp_path):
    (tmp_path / "folder").mkdir()
    trial = "trial: {template: {kind: panorama, name: woods.png}}\n"
    templates = "templates: [{kind: panorama, name: ../hill.exr}, {kind: panorama, name: open}]"
    path = written(tmp_path / "folder", trial + templates)
    sweep = load_sweep(path, {"trial.seed": "1"})
    assert sweep.trial.template.name == str(tmp_path / "folder" / "woods.png")
    assert [each.name for each in sweep.templates] == [
        str(tmp_path / "folder" / ".." / "hill.exr"),
        "open",
    ]


def test_pictures_that_are_varied_are_found_from_there_too(tmp_path):
    (tmp_path / "folder").mkdir()
    text = """
trial: {template: {kind: panorama, name: open}}
vary: template.name
values: [woods.png, dense]
"""
    points = list(load_sweep(written(tmp_path / "folder", text)).points)
    names = [str(tmp_path / "folder" / "woods.png"), "dense"]
    assert [point.trial.template.name for point in points] == names
    assert [point.template for point in points] == names


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("{vary: search.dark_counts, values: [1e-1, 10]}", [0.1, 10]),
        ("{vary: blurred, values: [true, false]}", [True, False]),
    ],
)
def test_values_are_what_they_mean(tmp_path, text, values):
    points = load_sweep(written(tmp_path, text)).points
    assert [(point.value, type(point.value)) for point in points] == [
        (value, type(value)) for value in values
    ]


def test_a_picture_on_the_command_line_is_found_from_the_working_folder(tmp_path):
    overrides = {"trial.template.kind": "panorama", "trial.template.name": "woods.png"}
    assert load_sweep(written(tmp_path, "{}"), overrides).trial.template.name == "woods.png"


def test_a_file_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(UserError, match="no such sweep; give a YAML file"):
        load_sweep(tmp_path / "absent.yaml")


def test_frequency_beyond_nyquist_depends_on_variant_and_size():
    Trial(template=GratingTemplate(cycles_per_frame=30, variant="periodic"), size=60)
    with pytest.raises(ValidationError, match="beyond half a cycle per pixel"):
        Trial(template=GratingTemplate(cycles_per_frame=30, variant="rot"), size=60)
    Trial(template=GratingTemplate(cycles_per_frame=30, variant="rot"), size=120)


def test_intensity_alone_may_stand_still():
    assert Trial(velocity_px=0, methods=("im",)).methods == ("IM",)


def test_code_that_a_file_names_is_run_only_where_that_is_allowed(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    canary = tmp_path / "canary"
    text = f"import pathlib\npathlib.Path({str(canary)!r}).touch()\ndef flow(first, second): ..."
    (tmp_path / "named_in_a_file.py").write_text(text)
    named = "[named_in_a_file:flow, LK]"
    path = written(tmp_path, f"trial: {{methods: {named}}}")
    for overrides in ({}, {"trial.methods": "[LK]"}):
        with pytest.raises(UserError, match=r"trial\.methods: .*by --allow-code"):
            load_sweep(path, overrides)
    assert not canary.exists()
    allowed = load_sweep(path, allows_code=True)
    typed = load_sweep(written(tmp_path, "{}"), {"trial.methods": named})
    for sweep in (allowed, typed):
        assert [each.name for each in sweep.trial.detectors] == ["named_in_a_file:flow", "LK"]
