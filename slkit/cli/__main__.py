"""python -m slkit.cli."""

from slkit.cli import main

main()
