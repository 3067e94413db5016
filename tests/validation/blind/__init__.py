"""Campaigns with a hidden truth, drawn by seed, on which `diagnose` is judged: draw, make, judge, count."""
