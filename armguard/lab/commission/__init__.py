"""Commissioning: measures an arm, its controller and its sources from a recording of stops.

No data sheet states how long a controller takes to obey, or how far a joint still moves. Each STOP
in a recording measures both. armguard names the figures that a recording does not contain.
"""
