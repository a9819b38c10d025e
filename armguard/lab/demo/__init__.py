"""`armguard demo`: a simulated cell, supervised by the same command as a real one.

`nodes` holds the two processes that stand for a real cell's perception and robot; `launcher`
starts them, `armguard run` and the view, shows what comes out, and ends them all. Nothing is
imported here, so that a node's process loads only what it needs.
"""
