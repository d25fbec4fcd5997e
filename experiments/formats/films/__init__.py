"""Pictures of a recording: those of one camera, or of several cameras in space.

A new way of storing pictures belongs here.
"""
