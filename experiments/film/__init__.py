"""Films of what the camera saw: estimates, marks and reasons drawn into frames, with OpenCV.

What may enter: what is drawn into a frame, and how such films are written. Each is imported from its own module.
"""
