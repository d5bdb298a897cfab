"""From a goal to a path that an arm can take: grid search, potential field, snake (CMU-92)."""
