"""`python -m evaluator`: the command line without an installed script."""

from evaluator.cli import main

main()
