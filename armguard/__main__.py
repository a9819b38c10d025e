"""`python -m armguard`: the same as the command `armguard`."""

import sys

from armguard.app.cli import main

if __name__ == "__main__":
    sys.exit(main())
