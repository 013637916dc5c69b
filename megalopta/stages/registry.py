"""The stages in order, and the dependencies of their output.

Beside settings, output depends on models of the program, libraries and their back ends: frames by
LLVM and by scalar code, or counts of two sensor models, look alike and are not. An interrupted
stage, or a dataset of many sequences, continues with the same or not at all.
"""

from collections.abc import Collection, Iterable, Mapping
from typing import Any

from megalopta.config.model import Configuration, by_content, differences
from megalopta.stages import benchmark, flow, render, sense
from megalopta.stages.declaration import Stage

STAGES: Mapping[str, Stage] = {
    stage.name: stage for stage in (render.STAGE, sense.STAGE, flow.STAGE, benchmark.STAGE)
}


def with_dependents(stages: Collection[str]) -> list[str]:
    """Stages and all that need one of them, in order."""
    found: set[str] = set()
    for name, stage in STAGES.items():
        if name in stages or found.intersection(stage.needs):
            found.add(name)
    return [name for name in STAGES if name in found]


def stage_configuration(configuration: Configuration, *stages: str) -> dict[str, Any]:
    """Parts of the configuration that the output of stages depends on."""
    names = {name for stage in stages for name in (*STAGES[stage].needs, stage)}
    fields = {field for name in names for field in STAGES[name].fields}
    # The backend changes speed and the draw of rendering noise, but not the content.
    exclude = {"render": {"backend"}}
    found: dict[str, Any] = by_content(
        configuration.model_dump(mode="json", include=fields, exclude=exclude)
    )
    return found


def provenance(stage: str, configuration: Configuration) -> dict[str, str]:
    """Return a stage's dependencies here and now: its model, libraries and their back ends."""
    declared = STAGES[stage]
    return {"model": declared.model(), **declared.machinery(configuration)}


def made_with(stages: Iterable[str], configuration: Configuration) -> dict[str, dict[str, str]]:
    """Return the dependencies of stages, other than settings, here and now."""
    return {stage: provenance(stage, configuration) for stage in stages}


def provenance_changes(before: Mapping[str, str], now: Mapping[str, str]) -> str:
    """Return the differences, such as "variant: llvm_ad_spectral → scalar_spectral".

    Entries that an older version of the program did not record are not compared.
    """
    recorded = {name: value for name, value in now.items() if name in before}
    return "; ".join(differences(before, recorded))
