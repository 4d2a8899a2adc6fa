"""One module a command; each has ``main(words) -> exit code``."""
