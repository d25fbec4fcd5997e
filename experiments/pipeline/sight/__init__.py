"""Measures marks in pictures: on the plane with one camera, in space with several.

A new arrangement of cameras belongs here.
"""
