"""Mann and Young (2006) reproduced: a file a figure or table, each a function make(bench) that returns a Part.

Source: B. P. Mann and K. A. Young (2006), "An empirical approach for delayed oscillator stability and parametric
identification", Proc. R. Soc. A 462, 2145-2160, doi 10.1098/rspa.2005.1677. Simulation is handed in with the bench.
"""

from __future__ import annotations

# in the order of the page; those that take longest are begun first
PARTS = ("fig1", "fig2", "dimension", "fig3", "fig4", "fig5", "table1", "table2", "fig6", "fig7", "errors", "band",
         "immersion")
LONGEST_FIRST = ("errors", "table1", "band", "immersion", "table2", "fig7", "fig2", "fig3", "fig1", "dimension", "fig6",
                 "fig5", "fig4")
