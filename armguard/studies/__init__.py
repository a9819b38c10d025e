"""Studies: what armguard's accuracy costs, what it does at the extremes, what faults do to it."""
