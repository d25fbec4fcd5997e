"""Files of other programs: recordings for ROS 2, Foxglove, PLUS and 3D Slicer, and tables of pose trackers.

The results of a run are also read here.
A new program's format belongs here. Import names from the modules themselves.
"""
