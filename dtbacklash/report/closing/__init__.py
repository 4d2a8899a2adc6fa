"""The page of a loop that was closed over a diagnosis."""
