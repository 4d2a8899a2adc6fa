"""Machines and places of the benchmark that is written by hand."""

MACHINES = {"001": "stage", "002": "stage", "003": "stage"}
PLACES = {"stage": {"table": "table", "load": "table", "top_plate": "table", "spring": "spring"}}
