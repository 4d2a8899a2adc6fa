"""What an experiment would show before it is made, and which one tells rivals apart."""
