"""The command line: `rbd stand`, `rbd simulate`, `rbd mechanism`, `rbd plane` and their reports."""
