"""The command `megalopta`, and `python -m megalopta`."""

from megalopta.cli.main import main

if __name__ == "__main__":
    main()
