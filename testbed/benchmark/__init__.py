"""The public benchmark: answers to sealed campaigns read from a file and checked, and scored against the truth.

`answers` is the form of an answer, `scores` counts. Campaigns are made, and baselines asked, by the command line, which alone
knows engines and analysis.
"""
