"""What a ranking says in words, and only what its intervals bear."""

from collections.abc import Sequence

from megalopta.benchmark.changes import Change, changes
from megalopta.benchmark.ranking_errors import FEWEST_SEQUENCES, STILL
from megalopta.benchmark.ranking_record import Order, Ranking
from megalopta.benchmark.sequence_truth import opposed
from megalopta.plotting.text import number

_TOLD = 3
"""Changes of one kind that are told in words; all are in the table"""


def findings(ranking: Ranking) -> list[str]:
    """Say where two methods change places, and of what this holds."""
    found = changes(ranking)
    kinds = dict.fromkeys(each.what for each in opposed(ranking.blocks))
    return [*(_told(ranking, found, what) for what in kinds), _scope(ranking)]


def _told(ranking: Ranking, found: Sequence[Change], what: str) -> str:
    if not any(_blocks(ranking, each[:2]) for each in opposed(ranking.blocks) if each.what == what):
        return f"Whether the order of methods changes with {what} cannot be told: no such blocks."
    own = [each for each in found if each.groups.what == what]
    if not own:
        return f"No change of the order of methods with {what} is beyond chance."
    # where the best method itself is another one first
    own.sort(key=lambda each: not _is_of_best(ranking, each))
    more = f"; and {len(own) - _TOLD} more, in the table" if len(own) > _TOLD else ""
    told = "; ".join(_sentence(ranking, each) for each in own[:_TOLD])
    return f"The order of methods changes with {what}: {told}{more}."


def _sentence(ranking: Ranking, change: Change) -> str:
    best = ", the best ones" if _is_of_best(ranking, change) else ""
    one, other = change.groups[:2]
    return (
        f"at {number(change.first.photons_per_frame)} photons {_placed(change.first)} ({one}), "
        f"{_placed(change.second)} ({other}){best}"
    )


def _placed(order: Order) -> str:
    error = f"{order.ratio:.2f} times its error, {order.low:.2f} to {order.high:.2f}"
    return f"{order.better} before {order.worse} with {error}"


def _is_of_best(ranking: Ranking, change: Change) -> bool:
    """Whether each of the two is surely the best of all methods in its group."""
    for order in (change.first, change.second):
        best = ranking.best_of(ranking.settings.finest, order.photons_per_frame, order.group)
        if best is None or not best.is_sure or best.method != order.better:
            return False
    return True


def _blocks(ranking: Ranking, groups: Sequence[str]) -> bool:
    return all(ranking.blocks.get(each) for each in groups)


def _scope(ranking: Ranking) -> str:
    count = len(ranking.sequences)
    if count >= FEWEST_SEQUENCES:
        return (
            f"Intervals are over {count} sequences, as a sample of others like them; where a "
            "group has blocks in few of them, they are wide, or missing."
        )
    return (
        f"This holds for {'this sequence' if count == 1 else 'these sequences'} alone: intervals "
        f"are over stretches of {'its' if count == 1 else 'their'} frames. Only "
        f"{FEWEST_SEQUENCES} sequences or more tell of others."
    )


def summary(ranking: Ranking) -> str:
    """Say which method has the lowest error at each number of photons."""
    finest, words = ranking.settings.finest, []
    for flux in sorted(ranking.settings.fluxes):
        best = ranking.best_of(finest, flux, "all")
        if best is not None:
            sure = "" if best.is_sure else " (not sure)"
            what = "no method beats the answer 0" if best.method == STILL else best.method
            words.append(f"{number(flux)}: {what}{sure}")
    return f"Lowest mean error by photons per frame: {', '.join(words)}."
