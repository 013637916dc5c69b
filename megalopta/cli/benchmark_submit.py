"""`megalopta benchmark submit`."""

from argparse import Namespace
from pathlib import Path

from megalopta.cli.command import Verbs, add_out, add_verb

_WIDTH = 150  # of the tables, whatever the terminal's


def declare(verbs: Verbs) -> None:
    """Add the verb."""
    purpose = "score flow that any program wrote, or methods, on pictures as they are: no photons"
    command = add_verb(verbs, "submit", purpose, _run)
    command.add_argument(
        "flow",
        help="folder of flow files (.flo, .flo5, .pfm, .npy or KITTI's PNG, px per frame), laid "
        "out as the truth is; or a method, such as DIS, module:function or an ONNX file, that is "
        "asked for the flow of the truth's pictures",
    )
    text = "folder of the true flow: a dataset, or one of Sintel, KITTI or Middlebury"
    command.add_argument("--truth", type=Path, required=True, help=text)
    command.add_argument("--program", help="name of what wrote it (default: that of its folder)")
    command.add_argument(
        "--leaderboard", type=Path, metavar="FILE", help="add the scores to this file, and show it"
    )
    add_out(command, "scores.json", "file of the scores")


def _run(options: Namespace) -> None:
    from rich.console import Console

    from megalopta.benchmark.scores import (
        add_entries,
        board_table,
        read_board,
        score_submission,
        score_table,
    )
    from megalopta.core import files

    if options.leaderboard:
        read_board(options.leaderboard)  # a damaged one is refused before the work
    scores = score_submission(options.flow, options.truth, options.program)
    files.write_text(options.out, scores.model_dump_json(indent=1) + "\n")
    console = Console(width=_WIDTH, markup=False, emoji=False)
    console.print(score_table(scores))
    print(options.out)
    if options.leaderboard:
        entries = add_entries(options.leaderboard, scores.overall)
        console.print(board_table(entries, scores.entries[0].truth_hash))
        print(options.leaderboard)
