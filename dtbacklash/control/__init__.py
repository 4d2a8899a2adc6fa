"""The controller: its design from the linear models, and its laws."""
