"""`python -m testbed`: the command line, for where the command `testbed` is not on the path."""

from testbed.cli import main

main()
