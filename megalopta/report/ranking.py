"""Section "Which method is best": the ranking against the true motion, where it was made."""

from dataclasses import dataclass

from markupsafe import Markup

from megalopta.benchmark.ranking_charts import atlas
from megalopta.benchmark.ranking_page import best_methods, order_changes
from megalopta.benchmark.ranking_run import FOLDER, read_ranking
from megalopta.dataset.store import Dataset


@dataclass(frozen=True)
class RankingSection:
    """Sentences and the atlas."""

    summary: str
    findings: tuple[str, ...]
    atlas: Markup
    page: str
    """Path of the whole ranking, from the report's folder"""


def ranking_section(dataset: Dataset) -> RankingSection | None:
    """Return the section; None where nothing was ranked. Raises UserError."""
    ranking = read_ranking(dataset.root / FOLDER)
    if ranking is None:
        return None
    return RankingSection(
        best_methods(ranking),
        tuple(order_changes(ranking)),
        atlas(ranking),
        f"{FOLDER}/ranking.html",
    )
