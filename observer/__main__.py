"""`python -m observer`."""

from observer.cli import main

main()
