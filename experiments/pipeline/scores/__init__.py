"""Scores of estimates without truth: innovations, statuses, withheld marks.

Figures and words on a run that need no truth belong here.
"""
