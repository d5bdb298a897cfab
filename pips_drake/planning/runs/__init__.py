"""What `pips plan` does: plans, judges and writes a scenario's motion."""
