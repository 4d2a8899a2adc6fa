"""The rig: what it is made of, which effects act on it, and its compiled simulation."""
