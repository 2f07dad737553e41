"""`python -m steered_marigold`: the command."""

from steered_marigold.cli import main

main()
