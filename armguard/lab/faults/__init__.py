"""`armguard faults`: faults made on purpose in a running cell, judged by what truly happened.

`catalogue` lists them, `campaign` makes them, `session` holds the processes that they strike,
`nodes` those of them that stand for a real cell's camera and robot. Nothing is imported here, so
that a node's process loads only what it needs.
"""
