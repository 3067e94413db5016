"""A milling simulator by another hand, and campaigns of its cuts as files: the command line is judged on them from outside.

simulator, plan, measure and files import nothing of the product; judge runs its commands, count counts their answers.
"""
