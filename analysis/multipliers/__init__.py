"""Characteristic multipliers from transients, the machine identified from them, and how well that is done under noise."""
