"""What a recording of tracked people says of a camera, and of the bounds and errors it needs.

Any recording will do: what a body-tracking kit has written, or motion capture. It is measured as it
is, with all that is hidden, swapped and noisy, because that is what a monitor will meet.
"""
