"""What a ranking says in words, and only what its intervals bear."""

from collections.abc import Callable

from megalopta.pages import number
from megalopta.ranking.errors import STILL
from megalopta.ranking.record import Ranking
from megalopta.ranking.truth import OPPOSED


def findings(ranking: Ranking) -> list[str]:
    """Say where the best method, or the order of two, is another one for two groups.

    Only what the data can tell in both groups is said.
    """
    found = []
    for one, other, what in OPPOSED:
        best = _joined(ranking, _change_of_best, one, other)
        order = _joined(ranking, _reversed_pairs, one, other)
        words = [
            f"The best method changes with {what}: {best}."
            if best
            else f"No change of the best method with {what} is beyond the noise."
        ]
        if order:
            words.append(f"The order of methods changes with {what}: {order}.")
        found.append(" ".join(words))
    return found


def _joined(
    ranking: Ranking, told: Callable[[Ranking, float, str, str], str], one: str, other: str
) -> str:
    at = {flux: told(ranking, flux, one, other) for flux in sorted(ranking.settings.fluxes)}
    return "; ".join(f"at {number(flux)} photons {text}" for flux, text in at.items() if text)


def _change_of_best(ranking: Ranking, flux: float, one: str, other: str) -> str:
    a, b = (ranking.best_of(ranking.settings.finest, flux, group) for group in (one, other))
    if not (a and b and a.is_sure and b.is_sure and a.method != b.method):
        return ""
    return f"{a.method} where it is {one}, {b.method} where it is {other}".replace(
        "it is parallax", "parallax is"
    ).replace("it is speed", "speed is")


def _reversed_pairs(ranking: Ranking, flux: float, one: str, other: str) -> str:
    """Pairs of which one method is better in one group, and the other in the other."""
    first, second = (ranking.sure_orders(flux, group) for group in (one, other))
    pairs = [f"{a} before {b}" for a, b in first if (b, a) in second]
    return f"{', '.join(pairs)} ({one}), the other way round ({other})" if pairs else ""


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
