"""The inner loops, in C99: plant, laws, steps, predictor and filter.

:mod:`.build` compiles them, and :mod:`.library` loads them.
"""
