"""The force that no effect explains: in time, over what it goes with, as a formula, and tried in a fit."""
