"""Files of other programs: recordings for ROS 2, Foxglove, PLUS and 3D Slicer, and tables of pose trackers.

The results of a run are read here, too, for these files and for Python.
What may enter: another program's format. Each is imported from its own module.
"""
