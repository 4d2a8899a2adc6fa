"""The judgement of a finished search: verdict, checks, limits, and the missing effort of free form."""
