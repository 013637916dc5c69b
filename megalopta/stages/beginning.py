"""Whether stages can begin: the dataset must agree with the configuration, or is made again.

A stage begins by agreeing with the configuration of everything that is already there; where they
differ it is refused with the differences, unless the user asks to redo it.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from megalopta.config.model import Configuration, differences
from megalopta.core.errors import UserError
from megalopta.core.progress import say
from megalopta.dataset.store import Dataset, existing
from megalopta.stages.ledger import Ledger, stage_configuration
from megalopta.stages.registry import STAGES, with_dependents


def begin_stages(
    root: Path, configuration: Configuration, stages: Sequence[str], redo: bool = False
) -> tuple[Dataset, list[str]]:
    """The dataset as it is, and the stages to make again, or a refusal. Nothing is changed here.

    Everything already there must come from the same configuration, and the stages that these need
    must be finished. With `redo`, these stages and whatever disagrees is to be made again, and what
    depends on them goes. So is, without being asked, what other code has quickly derived.
    """
    new = Dataset(root, configuration)
    old = existing(root) or new
    stale = [stage for stage in STAGES if _disagrees(old, configuration, stage)]
    changes = _changes(old.configuration, configuration, stale)
    if stale and not redo:
        raise UserError(
            f"{root} holds {' and '.join(stale)} output of another configuration "
            f"({changes}); choose another folder, or add --redo to replace it"
        )
    again = [stage for stage in stages if _is_to_be_made_again(old, stage, redo)]
    doomed = with_dependents([*stale, *again])
    for stage in [stage for stage in stages if stage not in doomed]:
        _refuse_mixture(new, stage)
    needs = {need for stage in stages for need in STAGES[stage].needs}
    for needed in [stage for stage in STAGES if stage in needs.difference(stages)]:
        if needed in doomed:
            raise UserError(
                f"{root}: --redo of {stages[0]!r} alone would remove the {needed!r} output, which "
                f"disagrees ({changes}); run with --redo first: "
                f"megalopta {STAGES[needed].command}"
            )
        Ledger(new).require(needed)
    return old, doomed


def _disagrees(old: Dataset, configuration: Configuration, stage: str) -> bool:
    before, now = (stage_configuration(each, stage) for each in (old.configuration, configuration))
    return before != now and Ledger(old).has(stage)


def _is_to_be_made_again(old: Dataset, stage: str, redo: bool) -> bool:
    ledger = Ledger(old)
    if redo or not ledger.is_outdated(stage):
        return redo and ledger.has(stage)
    if not STAGES[stage].is_derived:
        raise UserError(
            f"{old.root}: its {stage!r} output was made by another version of the program, which "
            "gives other numbers; add --redo to make it again"
        )
    say(f"{stage}: made by another version of the program, and made again")
    return True


def _refuse_mixture(dataset: Dataset, stage: str) -> None:
    """Refuse to add output to that of another renderer or library; nothing may be missing of it."""
    ledger = Ledger(dataset)
    if STAGES[stage].is_derived or not (changes := ledger.mixture(stage)):
        return
    if ledger.has(stage) and not ledger.is_finished(stage):
        raise UserError(
            f"{dataset.root}: its {stage!r} output is not whole and was made with something else "
            f"({changes}); go on with that (render.backend chooses the variant), or add --redo to "
            "make all of it again"
        )


def _changes(old: Configuration, new: Configuration, stages: Sequence[str]) -> str:
    changes = differences(_union(old, stages), _union(new, stages))
    more = f" and {len(changes) - 3} more" if len(changes) > 3 else ""
    return "; ".join(changes[:3]) + more


def _union(configuration: Configuration, stages: Sequence[str]) -> dict[str, Any]:
    return {
        key: value
        for stage in stages
        for key, value in stage_configuration(configuration, stage).items()
    }
