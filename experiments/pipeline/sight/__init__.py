"""Measured marks from pictures: on the plane by one camera, in space by several.

A new arrangement of cameras belongs here.
"""
