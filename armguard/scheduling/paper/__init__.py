"""The schedules of [Awareness]_, on pair numbers alone.

They see neither arms nor obstacles, so that the world of the paper runs on the same code.
"""
