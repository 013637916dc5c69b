"""The stages in order, and the settings and software that their output depends on."""

from collections.abc import Collection, Mapping
from typing import Any

from megalopta.config.model import Configuration, by_content, differences
from megalopta.stages import benchmark, flow, render, sense
from megalopta.stages.declaration import Stage

STAGES: Mapping[str, Stage] = {
    stage.name: stage for stage in (render.STAGE, sense.STAGE, flow.STAGE, benchmark.STAGE)
}


def with_dependents(stages: Collection[str]) -> list[str]:
    """Stages and all that need one of them, in order."""
    dependents: list[str] = []
    for name, stage in STAGES.items():
        if name in stages or set(dependents) & set(stage.needs):
            dependents.append(name)
    return dependents


def stage_configuration(configuration: Configuration, *stages: str) -> dict[str, Any]:
    """Parts of the configuration that the output of stages depends on."""
    names = {name for stage in stages for name in (*STAGES[stage].needs, stage)}
    fields = {field for name in names for field in STAGES[name].fields}
    # The backend changes speed and the draw of rendering noise, but not the content.
    exclude = {"render": {"backend"}}
    settings = configuration.model_dump(mode="json", include=fields, exclude=exclude)
    return dict(by_content(settings))


def differences_text(old: Mapping[str, Any], new: Mapping[str, Any]) -> str:
    """Return what differs between two dumped configurations, at most three settings; "" if none."""
    listed = differences(old, new)
    more = f" and {len(listed) - 3} more" if len(listed) > 3 else ""
    return "; ".join(listed[:3]) + more


def provenance_changes(before: Mapping[str, str], now: Mapping[str, str]) -> str:
    """Return the differences, such as "variant: llvm_ad_spectral → scalar_spectral".

    Entries that an older version of the program did not record are not compared.
    """
    recorded = {name: value for name, value in now.items() if name in before}
    return "; ".join(differences(before, recorded))
