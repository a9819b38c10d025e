"""Measures the claims of the paper about its schedules, in a world like that of the paper."""
