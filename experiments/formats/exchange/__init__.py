"""Files of other programs: recordings for ROS 2, Foxglove, PLUS and 3D Slicer, and tables of pose trackers.

Results of a run are also read here, for export and for Python.
A new program's format belongs here. Import names from the modules themselves.
"""
