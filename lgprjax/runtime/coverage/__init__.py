"""The coverage process: the map of what is worked, live."""
