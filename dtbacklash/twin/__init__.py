"""The digital twin: the gap from a buffer, what else has changed, and who answers the controller."""
