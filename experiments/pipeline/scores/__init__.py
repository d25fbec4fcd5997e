"""Scores of estimates without truth: innovations, statuses, and marks that the filter does not use.

Figures and messages on a run that need no truth belong here.
"""
