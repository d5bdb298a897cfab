"""NASA's remote manipulator task simulator of 1971: acquire a payload, lift it out, dock it."""
