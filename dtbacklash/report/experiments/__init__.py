"""The pages of experiments that are planned."""
