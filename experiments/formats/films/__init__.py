"""Pictures of a recording, from one camera or from several cameras in space.

A new way of storing pictures belongs here.
"""
