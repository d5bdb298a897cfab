"""A cable-suspended robot and what it can do: the payload bay radiators' surveyor of 1996."""
