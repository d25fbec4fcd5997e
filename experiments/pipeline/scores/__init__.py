"""Scores of estimates without truth: innovations, statuses, withheld marks.

Figures and messages on a run that need no truth belong here.
"""
