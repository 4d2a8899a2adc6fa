"""Every choice a user can make, a folder a choice; a folder `conf` in the current directory extends it."""
