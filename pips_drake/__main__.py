"""`python -m pips_drake` is the command `pips`."""

import sys

from pips_drake.cli import main

if __name__ == "__main__":
    sys.exit(main())
