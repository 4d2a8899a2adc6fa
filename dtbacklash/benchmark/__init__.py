"""A benchmark that any tool can enter: which physics is missing in a machine's model, where, and how much of it."""
