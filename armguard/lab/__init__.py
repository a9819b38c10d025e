"""Studies, simulation and tools beside a running cell, which loads none of them."""
