"""The process that writes a recording; started by `Recorder`."""

import sys

from armguard.recording.writer import main

if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
