"""Studies: what armguard's accuracy costs, what it does at the extremes, what faults do to it.

`rows` keeps what is measured one by one, and `cluster` measures it on other machines.
"""
