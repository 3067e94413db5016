"""Scenarios: which machine, which cuts, what differs by chance; expanded, a list of runs."""
