"""What the core computes, by other means: its steps and recursions in plain Python."""
