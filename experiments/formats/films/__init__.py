"""Pictures of a recording: of one camera, or of several in space.

Another way of storing pictures belongs here.
"""
