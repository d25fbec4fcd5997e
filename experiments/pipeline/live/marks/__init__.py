"""Marks that another tracker sends while it sees them: by UDP, through a pipe, or as it once wrote them.

The transport is a `Feed`, which passes frames or lines to a `LiveMarks`; another protocol is another feed. The line
format is documented in docs/live-marks.md.
"""
