"""What a stage's output depends on beside its settings, so that nothing is made of two kinds.

Frames by LLVM and by scalar code, or counts of two sensor models, look alike and are not: a stage
that was broken off, or a dataset of many sequences, goes on with the same or not at all.
"""

from collections.abc import Mapping

from megalopta.config.model import Configuration, differences
from megalopta.stages.registry import STAGES


def provenance(stage: str, configuration: Configuration) -> dict[str, str]:
    """Return what makes a stage's output here and now: its model, libraries and what runs them."""
    declared = STAGES[stage]
    return {"model": declared.model(), **declared.machinery(configuration)}


def provenance_changes(before: Mapping[str, str], now: Mapping[str, str]) -> str:
    """Return what differs, such as "variant: llvm_ad_spectral → scalar_spectral", or nothing.

    What was not recorded, by an older version of the program, is not compared.
    """
    recorded = {name: value for name, value in now.items() if name in before}
    return "; ".join(differences(before, recorded))
