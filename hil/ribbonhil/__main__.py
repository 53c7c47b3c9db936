"""`python -m ribbonhil` is the command `ribbonhil`."""

from ribbonhil.cli import main

main()
