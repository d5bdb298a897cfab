"""Runs: what `pips simulate` does with a cable robot's scenario."""
