from .board import (
    add_entries as add_entries,
    read_board as read_board,
)
from .pairing import (
    pictures_of as pictures_of,
    true_flows as true_flows,
)
from .scores import (
    Entry as Entry,
    Scores as Scores,
    score_submission as score_submission,
)
from .tables import (
    board_table as board_table,
    score_table as score_table,
)
