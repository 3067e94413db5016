"""Sweeps: the runs of a scenario in batches, on any number of workers, to be continued where they were interrupted."""
