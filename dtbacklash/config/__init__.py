"""Everything a user can choose: dataclasses with units in the names and range checks."""
