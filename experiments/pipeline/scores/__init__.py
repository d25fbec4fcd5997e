"""Scores of estimates without any truth: innovations, statuses, withheld marks.

What may enter: figures and words on a run that need no truth.
"""
