"""The stages in their order."""

from collections.abc import Collection, Mapping

from megalopta.stages import (
    benchmark,
    flow,
    render,
    sense,
)
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
