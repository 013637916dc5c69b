"""What a stage's output depends on beside its settings."""

from megalopta.stages.registry import STAGES, provenance, provenance_changes


def test_frames_depend_on_variant_and_libraries(tiny):
    found = provenance("render", tiny)
    assert {"model", "variant", "mitsuba", "drjit"} <= found.keys()
    assert ("llvm" in found) == found["variant"].startswith("llvm")


def test_another_variant_is_told(tiny):
    scalar = tiny.model_copy(
        update={"render": tiny.render.model_copy(update={"backend": "scalar"})}
    )
    before = {**provenance("render", scalar), "variant": "llvm_ad_spectral", "llvm": "19.1.0"}
    told = provenance_changes(before, provenance("render", scalar))
    assert told == "variant: llvm_ad_spectral → scalar_spectral; llvm: 19.1.0 → absent"


def test_what_was_not_recorded_is_not_compared(tiny):
    for stage in STAGES:
        assert provenance_changes({}, provenance(stage, tiny)) == ""
        assert provenance_changes({"model": "old"}, provenance(stage, tiny)).startswith(
            "model: old"
        )
