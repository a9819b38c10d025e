"""Measures a camera's errors and the bounds it needs, from recordings of tracked people.

Any recording of a body-tracking kit or of motion capture is usable. It is measured with all hidden,
swapped and noisy samples, because a monitor gets such samples.
"""
