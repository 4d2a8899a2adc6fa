"""What all tests share."""

from hypothesis import settings

# repeatable examples, and no deadlines: the first call of a compiled function compiles it
settings.register_profile("house", deadline=None, derandomize=True)
settings.load_profile("house")
