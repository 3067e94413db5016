"""How sure: machines drawn from what is known of one, the chance that a cut is stable, and the cut that would tell most."""
