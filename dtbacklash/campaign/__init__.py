"""Campaigns: many jobs of which each is kept and none is done twice, whatever they are and whoever does them.

A sweep is one (:mod:`.sweep`), and so is each stage of a proof (:mod:`dtbacklash.prove.run`). :mod:`.jobs` says what a
job is, :mod:`.backends` who does it, :mod:`.engine` sees to it that all are done, :mod:`.progress` shows how far it is.
What one job computes is the matter of an application (:mod:`.application`), and of no file here.
"""
