"""Commissioning: measures an arm, its controller and its sources from a recording of stops.

No data sheet says how long a controller takes to obey, or how far a joint still goes. Each STOP in
a recording is a measurement of both. What a recording cannot say is named, and not made up.
"""
