"""Studies, simulations and tools; a running cell does not import them."""
