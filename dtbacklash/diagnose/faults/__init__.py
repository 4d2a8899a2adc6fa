"""Faults of wiring, sensors and sampling, told before any physics is tried, so that none has to stand in for them."""
