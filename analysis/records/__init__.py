"""What a recording says by itself: segments, noise, lines, free decays, marks, and the report of `testbed inspect`."""
