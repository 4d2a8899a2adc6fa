"""The page of a benchmark's score."""
