"""A stage that was broken off goes on with the same renderer and libraries, or not at all."""

import dataclasses
import json

import pytest

from megalopta.core.errors import UserError
from megalopta.dataset.store import open_sequence
from megalopta.stages import registry
from megalopta.stages.ledger import Ledger
from megalopta.stages.pipeline import run_stage
from megalopta.stages.registry import STAGES
from megalopta.stages.render import FrameWriter

from .test_pipeline import content


@pytest.fixture
def begun(whole, tmp_path, monkeypatch):
    """A dataset whose rendering stopped in its third frame."""
    write = FrameWriter.write

    def interrupted(self, index):
        if index == 2:
            raise KeyboardInterrupt
        write(self, index)

    root = tmp_path / "begun"
    with monkeypatch.context() as patched, pytest.raises(KeyboardInterrupt):
        patched.setattr(FrameWriter, "write", interrupted)
        run_stage(root, open_sequence(whole).configuration, "render")
    return open_sequence(root)


def with_backend(configuration, backend):
    rendering = configuration.render.model_copy(update={"backend": backend})
    return configuration.model_copy(update={"render": rendering})


def test_frames_of_two_variants_are_not_mixed(begun):
    before = content(begun.root)
    scalar = with_backend(begun.configuration, "scalar")
    if "llvm" not in STAGES["render"].machinery(begun.configuration):
        pytest.skip("no LLVM here")
    with pytest.raises(
        UserError, match=r"'render' output is not whole .*variant: llvm_ad_\w+ → scalar_.*--redo"
    ):
        run_stage(begun.root, scalar, "render")
    assert content(begun.root) == before
    run_stage(begun.root, scalar, "render", redo=True)
    assert json.loads(begun.scene_record.read_text("utf-8"))["variant"] == "scalar_spectral"


def test_with_the_same_it_goes_on_to_the_same_bytes(begun, whole):
    run_stage(begun.root, begun.configuration, "render")
    expected = content(whole / "radiance") | content(whole / "truth")
    found = content(begun.root / "radiance") | content(begun.root / "truth")
    assert found == expected
    assert Ledger(begun).entry("render") == Ledger(open_sequence(whole)).entry("render")


def test_a_finished_stage_is_kept_whatever_made_it(whole_copy, capsys):
    before = content(whole_copy)
    scalar = with_backend(open_sequence(whole_copy).configuration, "scalar")
    run_stage(whole_copy, scalar, "render")
    assert "has it already" in capsys.readouterr().err
    assert content(whole_copy).keys() == before.keys()
    assert all(content(whole_copy)[n] == before[n] for n in before if n != "dataset.yaml")


@pytest.mark.parametrize("what", ["model", "machinery"])
def test_counts_of_two_sensor_models_or_libraries_are_not_mixed(whole_copy, monkeypatch, what):
    dataset = open_sequence(whole_copy)
    Ledger(dataset).forget("sense")
    Ledger(dataset).begin("sense")
    (whole_copy / "counts/grating/spadcam-starlight.zarr").mkdir(parents=True)  # one of several
    changed = {"model": lambda: "8"} if what == "model" else {"machinery": lambda _: {"numpy": "9"}}
    other = dataclasses.replace(registry.STAGES["sense"], **changed)
    monkeypatch.setitem(registry.STAGES, "sense", other)
    before = dataset.record_path.read_text("utf-8")
    with pytest.raises(
        UserError, match=r"'sense' output is not whole .*(model: 7 → 8|numpy: .* → 9)"
    ):
        run_stage(whole_copy, dataset.configuration, "sense")
    assert dataset.record_path.read_text("utf-8") == before
