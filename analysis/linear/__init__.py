"""The linear machine: its delay equation, multipliers by temporal elements and by collocation, stability charts."""
