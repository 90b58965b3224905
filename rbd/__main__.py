"""`python -m rbd`."""

from rbd.cli.app import main

if __name__ == "__main__":
    main()
