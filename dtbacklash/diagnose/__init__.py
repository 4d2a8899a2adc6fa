"""Diagnosis: where a recording and the simulation differ, what physics is missing, and whether it fits better."""
