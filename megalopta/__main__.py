"""`python -m megalopta` is the command line."""

from megalopta.cli import main

main()
