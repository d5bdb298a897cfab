"""The words between what moves the tip along its path and what tells it to."""

#: Phases of a run, as `TipPathSource.phase` says them.
EXTENDING, DWELLING, RETRACTING, DONE = 0.0, 1.0, 2.0, 3.0

#: Words of `TipPathSource.command`: go on, stand, go back, and go out again after having gone back.
RUN, HOLD, RETRACT, EXTEND = 1.0, 0.0, -1.0, 2.0
WORDS = (RUN, HOLD, RETRACT, EXTEND)
