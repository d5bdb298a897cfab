"""The path planner: from a goal to a path that an arm can follow, clear of everything (CMU-92)."""
