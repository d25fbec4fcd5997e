"""Films with estimates, marks and reasons drawn over the camera's pictures.

A new kind of drawing belongs here.
"""

# Import names from the modules themselves.
