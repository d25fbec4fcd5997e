"""What a frame shows: marks looked for in the picture and measured on the plane, reference marks and the pose by them.

What may enter: another thing that stands still or moves in view. Each is imported from its own module.
"""
