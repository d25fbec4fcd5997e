"""Marks from another tracker: live by UDP, live through a pipe, or recorded.

The transport is a `Feed`, which passes frames or lines to a `LiveMarks`; a new protocol needs its own feed. The line
format is documented in docs/live-marks.md.
"""
