"""Films of what the camera saw: estimates, marks, reasons.

What may enter: another drawing.
"""

# Import each from its own module.
