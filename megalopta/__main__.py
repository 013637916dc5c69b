"""The command `megalopta`, and `python -m megalopta`.

Loading what the command line needs takes a second or two; Ctrl-C in it is no reason for a
traceback.
"""

import sys


def main() -> None:
    """Load and run the command line."""
    try:
        from megalopta.cli import main as cli
    except KeyboardInterrupt:
        sys.exit(130)
    cli.main()


if __name__ == "__main__":
    main()
