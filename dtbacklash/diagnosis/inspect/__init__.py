"""Faults of wiring, sensors and sampling, found before any physics is tried."""
