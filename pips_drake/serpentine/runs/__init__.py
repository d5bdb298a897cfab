"""What the commands do: follow, check and simulate, with their figures and judgement."""
