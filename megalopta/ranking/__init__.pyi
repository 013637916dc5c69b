from .charts import atlas as atlas
from .errors import STILL as STILL
from .findings import findings as findings, summary as summary
from .folder import FOLDER as FOLDER, read_ranking as read_ranking, run_ranking as run_ranking
from .intervals import Best as Best, Interval as Interval, Ratio as Ratio
from .measured import Example as Example
from .methods import velocity_methods as velocity_methods
from .page import write_ranking as write_ranking
from .pooling import Pooling as Pooling
from .record import BOUND as BOUND, Ranking as Ranking
from .run import rank_methods as rank_methods
from .settings import RankingSettings as RankingSettings
