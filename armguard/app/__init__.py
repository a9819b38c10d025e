"""The command `armguard`: the loop around a monitor, cells, demos, processes.

Nothing is imported here: the command line is `armguard.app.cli`, and each of its processes loads
only what it needs.
"""
