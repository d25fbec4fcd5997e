"""Files of other programs: recordings for ROS 2, Foxglove, PLUS and 3D Slicer, and tables of pose trackers.

The results of a run are also read here, for these files and for Python.
Another program's format belongs here. Each is imported from its own module.
"""
