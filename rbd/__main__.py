"""`python -m rbd`."""

from rbd.cli.app import main

main()
