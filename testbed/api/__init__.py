"""The work behind every command, as plain functions and frozen objects: what `import testbed` offers.

One file a command. The command line calls these functions and prints what they return, so that both give the same answer.
"""
