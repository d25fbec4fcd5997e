"""Files of other programs: recordings for ROS 2, Foxglove, PLUS and 3D Slicer, and tables of pose trackers.

What may enter: another program's format. Each is imported from its own module.
"""
