from .errors import (
    STILL as STILL,
    Best as Best,
    Interval as Interval,
)
from .folder import run_ranking as run_ranking
from .page import write_ranking as write_ranking
from .pooling import Pooling as Pooling
from .run import (
    BOUND as BOUND,
    Ranking as Ranking,
    rank_methods as rank_methods,
)
from .settings import RankingSettings as RankingSettings
