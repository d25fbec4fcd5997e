"""Measured marks from pictures: on the plane by one camera, in space by several.

Another arrangement of cameras belongs here.
"""
