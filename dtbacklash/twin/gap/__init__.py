"""The gap from a buffer: observer, estimate, its standard error under a wrong model, guard; the novelty that asks."""
