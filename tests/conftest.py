"""What all tests rely on."""

import signal

# Where a script starts pytest in the background, all that it starts would ignore Ctrl-C.
signal.signal(signal.SIGINT, signal.default_int_handler)
