"""What a ranking says in words, and only what its intervals bear."""

from megalopta.pages import number
from megalopta.ranking.errors import STILL
from megalopta.ranking.record import Ranking

_OPPOSED = (
    ("parallax low", "parallax high", "parallax"),
    ("visible", "occluded", "occlusion"),
    ("smooth", "depth edge", "edges of depth"),
    ("speed low", "speed high", "speed"),
)


def findings(ranking: Ranking) -> list[str]:
    """Say where the best method is another one for two groups, if the data can tell both."""
    finest, found = ranking.settings.finest, []
    for one, other, what in _OPPOSED:
        changes = []
        for flux in sorted(ranking.settings.fluxes):
            a, b = (ranking.best_of(finest, flux, group) for group in (one, other))
            if a and b and a.is_sure and b.is_sure and a.method != b.method:
                changes.append(
                    f"at {number(flux)} photons {a.method} where it is {one}, {b.method} where it "
                    f"is {other}".replace(f"it is {what} ", f"{what} is ")
                )
        changed = "; ".join(changes)
        found.append(
            f"The best method changes with {what}: {changed}."
            if changes
            else f"No change of the best method with {what} is beyond the noise."
        )
    return found


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
