from .errors import STILL, Best, Interval
from .folder import run_ranking
from .page import write_ranking
from .pooling import Pooling
from .run import BOUND, Ranking, rank_methods
from .settings import RankingSettings

__all__ = [
    "BOUND",
    "STILL",
    "Best",
    "Interval",
    "Pooling",
    "Ranking",
    "RankingSettings",
    "rank_methods",
    "run_ranking",
    "write_ranking",
]
