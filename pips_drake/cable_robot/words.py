"""The words of a cable robot's scenarios; this module loads nothing that is slow to load."""

#: What a scenario may ask.
TASKS = ("statics", "workspace", "survey", "cable_break")
#: How a survey is flown.
FLIGHTS = ("station", "rest")
#: Names of `tension_methods`, which compiles.
TENSION_METHODS = ("least_norm", "least_infinity", "closed_form", "analytic_center")
#: What winches are told.
CONTROLS = ("length", "tension")
