"""The command `megalopta`, and `python -m megalopta`."""

import sys

if __name__ == "__main__" and not sys.flags.safe_path:
    del sys.path[0]  # the working folder, which may hold modules of the same names

from megalopta.cli.main import main

if __name__ == "__main__":
    main()
