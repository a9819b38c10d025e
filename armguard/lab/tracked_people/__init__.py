"""Measures a camera's errors and the bounds it needs, from recordings of tracked people.

Any recording will do: what a body-tracking kit has written, or motion capture. It is measured as it
is, with all that is hidden, swapped and noisy, because that is what a monitor will meet.
"""
