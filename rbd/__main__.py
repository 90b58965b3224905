"""`python -m rbd`."""

from rbd.cli import main

main()
