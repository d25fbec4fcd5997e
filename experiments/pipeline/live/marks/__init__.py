"""Marks from another tracker: live by UDP, through a pipe, or recorded.

The transport is a `Feed`, which passes frames or lines to a `LiveMarks`; another protocol is another feed. The line
format is documented in docs/live-marks.md.
"""
