"""`python -m pips_drake` is the command `pips`."""

from pips_drake.cli import main

if __name__ == "__main__":
    main()
