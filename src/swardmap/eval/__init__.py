"""How far a map can be trusted: the paper's evaluation (Sec. 4), an error budget, and a measured margin.

Every number comes from integer counts that merge in any order, so that one process, many processes
and a cluster report the same digits.
"""
