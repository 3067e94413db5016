"""The machine that campaigns of tests are cut with, and what its user believes of it."""

from testbed.machine import Cutter, Cutting, Model, Structure

TRUE = Model(Structure(2.573, 146.4225, 0.0032), Cutter(), Cutting("up-milling", 0.162, 5.5e8, 2.0e8))
BELIEVED = Model(Structure(2.573, 148.0, 0.0040), Cutter(), Cutting("up-milling", 0.162, 6.3e8, 1.7e8))
