"""The remote manipulator's station, and the parts that it is composed of."""
