"""The process that writes a recording; started by `Recorder`."""

import atexit
import gc
import sys

from armguard.recording.writer import main

if __name__ == "__main__":
    # What is left at the end goes with the process: to collect it would take up to 0.3 s.
    atexit.register(gc.freeze)
    sys.exit(main(sys.argv[1:]))
