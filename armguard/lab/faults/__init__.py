"""`armguard faults`: injects faults into a running cell, and judges each by the true outcome.

`catalogue` lists them, `campaign` makes them, `session` holds the processes that they strike,
`nodes` those of them that stand for a real cell's camera and robot. Nothing is imported here, so
that a node's process loads only what it needs.
"""
