"""Certified clearance: bounds over every instant of a motion, proved by separating planes."""
