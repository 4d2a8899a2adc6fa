"""The steps of the simulation in plain Python: as the core has them in C, to the last bit."""
