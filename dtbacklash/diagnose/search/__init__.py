"""The search for missing effects: what is added, tried against its rivals, and taken back."""
