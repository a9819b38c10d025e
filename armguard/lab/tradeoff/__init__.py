"""Measures what accuracy costs: runs one scene with all settings of the ladder."""
