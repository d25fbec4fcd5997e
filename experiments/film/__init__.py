"""Films of what the camera saw: estimates, marks, reasons.

A new kind of drawing belongs here.
"""

# Import each from its own module.
