"""`python -m deltatune`: the command line."""

from deltatune.cli.main import main

main()
