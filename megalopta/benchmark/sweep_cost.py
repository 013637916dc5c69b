"""How long a sweep takes, said before it begins."""

from megalopta.benchmark.sweep import Sweep
from megalopta.core.errors import UserError
from megalopta.core.progress import duration, say
from megalopta.stages.estimate import BENCHED_PER_S, LONGEST_S, WORTH_TELLING_S

_FLUXES = 20
"""At which a search measures a detector."""


def announce_sweep(sweep: Sweep) -> None:
    """Say how many trials a sweep has; refuse one that takes longer than a month."""
    trials = sweep.trials
    seconds = sum(
        trial.size**2
        * len(trial.methods)
        * (trial.search.frames + trial.search.summed_frames)
        * trial.search.phases
        * trial.search.repeats
        * _FLUXES
        / BENCHED_PER_S
        for trial in trials
    )
    if seconds > LONGEST_S:
        raise UserError(
            f"sweep: {len(trials)} trials would take about {duration(seconds)} of work, more than "
            f"the longest that is begun, {duration(LONGEST_S)}; lower trial.search.repeats or "
            "frames, or give fewer values"
        )
    if seconds > WORTH_TELLING_S:
        say(f"sweep: {len(trials)} trials, about {duration(seconds)}")
