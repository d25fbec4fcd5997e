"""The pictures of a recording: of one camera, or of several in space.

What may enter: another way in which a recording stores pictures.
"""
